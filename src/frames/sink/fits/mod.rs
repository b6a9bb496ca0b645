//! FITS images: a writer of the little that frames need, and a reader of one image, of other programs too.
//!
//! Source: "Definition of the Flexible Image Transport System", version 4.0 (IAU FITS Working Group, 2018). One
//! primary array of two axes; 16-bit unsigned as `BITPIX = 16` with `BZERO = 32768`, or IEEE floats (`-32`, `-64`).
//! The first row of the file is the top row of the image (`ROWORDER = 'TOP-DOWN'`); most viewers draw the first row
//! at the bottom, so they show the image upside down. FITS counts pixels from 1: pixel (x, y) here is (x + 1, y + 1)
//! there.
//!
//! The WCS maps pixels to ICRS catalog places at the epoch of the frame (`keywords`); `DATASUM` and `CHECKSUM` as in
//! the standard (`card`).
//!
//! Frames of data sets are compressed without loss (`compressed`), which also reads such files, `fpack`'s too.
//!
//! Limits: one image of a file, no tables, no `CONTINUE`; long text is cut; of compressed images, integers by `RICE_1`.
//!
//! Checked outside the tests with astropy 8.0.2 on files of this writer (u16, f32, f64, odd sizes):
//! `verify('exception')` is silent with every warning turned into an error, every card's own verification passes, the
//! pixels are equal bit by bit, the 64-bit seed and the nanosecond time are equal to the last digit, `Time(DATE-OBS)`
//! and `Time(MJD-OBS)` agree to 2 us, `Unit(BUNIT)` parses, and zlib gives the same CRC-32 as `PIXCRC32` and
//! `frames.csv`.

pub mod card;
mod compressed;
pub mod image;
pub mod keywords;
pub mod read;
mod rice;

pub use card::{Header, Value};
pub use compressed::write_compressed_frame;
pub use image::{FitsImage, Pixels, write_image};
pub use keywords::{write_electrons, write_frame};
pub use read::read_image;

/// Files are made of blocks of this many bytes.
const BLOCK_BYTES: usize = 2880;
