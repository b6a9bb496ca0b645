//! Data sets: many images of one kind of camera with labels, drawn from distributions, in files that other tools read.
//!
//! In the order of the flow:
//!
//! * [`spec`]: the file that describes a data set; [`distribution`] and [`attitudes`]: what it draws from;
//! * [`recipe`]: what one item shows, from its number alone; [`distribution::Draws`]: its random numbers;
//! * [`studio`]: the camera of one shard, and its images; [`outline`]: boxes and masks of targets;
//! * [`labels`]: tables of items and stars; [`image_files`]: FITS, PNG, WebDataset, Zarr; [`coco`]: boxes for detectors;
//! * [`folder`]: one shard on disk; the whole folder, its card and its checksums;
//! * [`mod@make`]: workers, resumption and progress.
//!
//! Item `i` of a data set has the same bits whoever draws it: on one worker or many, alone or after others, in one go or
//! after a kill. Tests: beside the code, and `hil_scripts/tests/test_data_sets.py` with the readers of other people.

pub mod attitudes;
pub mod coco;
pub mod distribution;
pub mod folder;
pub mod image_files;
pub mod labels;
pub mod make;
pub mod outline;
pub mod recipe;
pub mod spec;
pub mod studio;

pub use make::{Order, Progress, Summary, make};
pub use recipe::Recipe;
pub use spec::Spec;
pub use studio::{Item, Studio};
