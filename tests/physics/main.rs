//! Physics: the stimulator against independent computations.
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod analytic_motion;
mod apparent_places;
mod attitude_methods;
mod bounds;
mod bus_jitter;
mod bus_jitter_frames;
mod chart;
mod frames;
mod measure;
mod noise;
mod poisson_methods;
mod psf_field;
mod psf_files;
mod psf_models;
mod random_scenes;
mod scene;
mod stability;
mod stamps;
mod time_correlation;
