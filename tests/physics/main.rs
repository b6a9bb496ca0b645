//! Physics: the stimulator against independent computations.
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod analytic_motion;
mod apparent_places;
mod apparent_vectors;
mod attitude_methods;
mod bounds;
mod bus_jitter;
mod bus_jitter_frames;
mod chart;
mod dark_current;
mod deep_sky;
mod detector_spatial;
mod display_calibration;
mod fidelity;
mod field_light;
mod flats;
mod frames;
mod line_noise;
mod measure;
mod noise;
mod photon_transfer;
mod overlap;
mod poisson_methods;
mod psf_chain;
mod psf_field;
mod psf_files;
mod psf_models;
mod radiometry;
mod random_scenes;
mod response;
mod scene;
mod snr;
mod stability;
mod stamps;
mod targets;
mod time_correlation;
