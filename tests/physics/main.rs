//! Physics: the stimulator against independent computations.

mod apparent_places;
