//! Keys of descriptions of data sets: declared here for reference, schema, templates and the check of keys. Distributions are
//! checked by those who draw from them.
#![allow(dead_code, reason = "crates above read the values of these keys, after their check")]

use crate::key::section;
use crate::key_type::{Any, Raw, Shape, Whole, Word};

/// Words for a value that may be drawn.
const LAW: &str = "distribution: { uniform = [a, b] }, { log_uniform = [a, b] }, { normal = [mean, sigma] }, { integer = [a, b] }, \
                   { choice = [...] }";

section! {
    /// A data set of drawn images with labels.
    DataSetKeys at "" {
        /// Its name.
        name: String = Needed, "text";
        /// Its purpose.
        description: String = "", "text";
        /// Licence of the images.
        licence: String = "not stated", "text";
        /// Seed of everything that is drawn.
        seed: Whole<u64> = 1, 0..=i64::MAX;
        /// Camera file, or the name of a built-in one.
        camera: String = Needed, "path";
        /// Bench with observer, bodies, targets, layers of stars and accuracy.
        bench: String = Optional, "path";
        /// Faults that some items have: the keys of an [[event]] without its times, each with numbers or distributions, and
        /// probability, the share of items that have it.
        fault: Raw<Vec<toml::Table>> = Optional, Shape::list(Shape::Table("keys of an event, and probability"));
        /// Targets that items have: the keys of a [[target]], each with numbers or distributions, and count, how many.
        target: Raw<Vec<toml::Table>> = Optional, Shape::list(Shape::Table("keys of a target, and count"));
        tables:
        /// Attitudes of the items.
        attitude: ItemAttitudeKeys;
        /// When the items are exposed.
        time: ItemTimeKeys;
        /// Motion within the exposure.
        motion: ItemMotionKeys;
        /// Keys that change from shard to shard.
        draw: DrawnKeys;
        /// Files that are written.
        output: DataSetOutputKeys;
    }

    /// Attitudes of the items.
    ItemAttitudeKeys at "attitude" {
        /// Every rotation as likely; boresights evenly over a cap of the sky; a list; or those of a file.
        kind: Word<()> = "uniform", [("uniform", ()), ("cap", ()), ("list", ()), ("file", ())];
        /// Right ascension of the middle of a cap.
        ra_deg: f64 = Optional, Finite;
        /// Its declination.
        dec_deg: f64 = Optional, Within(-90.0, 90.0);
        /// Its radius.
        radius_deg: f64 = Optional, Within(0.0, 180.0);
        /// Right ascension, declination and roll of each attitude of a list.
        ra_dec_roll_deg: Raw<Vec<[f64; 3]>> = Optional, Shape::list(Shape::numbers(3));
        /// CSV, AEM or STK file of attitudes.
        path: String = Optional, "path";
    }

    /// When the items are exposed.
    ItemTimeKeys at "time" {
        /// First middle of an exposure, UTC.
        from_utc: String = Computed("2026-01-01T00:00:00Z"), "time as RFC 3339";
        /// Last one.
        to_utc: String = Computed("from_utc"), "time as RFC 3339";
    }

    /// Motion within the exposure.
    ItemMotionKeys at "motion" {
        /// Three numbers about the sensor's axes, or one about a random axis, deg/s.
        rate_deg_s: Raw<toml::Value> = Optional, drawn();
        /// Standard deviation of the line of sight's positions, each axis, arcsec.
        jitter_arcsec: Raw<toml::Value> = Optional, drawn();
        /// Independent positions of equal weight within the exposure.
        jitter_positions: Whole<u32> = Optional, 1..=4096;
    }

    /// Keys that change from shard to shard.
    DrawnKeys at "draw" {
        /// Dotted keys of the camera file and their distributions.
        camera: Raw<toml::Table> = Optional, Shape::Table("keys and distributions");
        /// Dotted keys of the bench and their distributions.
        bench: Raw<toml::Table> = Optional, Shape::Table("keys and distributions");
    }

    /// Files that are written.
    DataSetOutputKeys at "output" {
        /// Form of the images.
        images: Word<()> = "fits", [("fits", ()), ("png", ()), ("webdataset", ()), ("zarr", ())];
        /// Items of a shard, which share one drawn camera and bench.
        shard_items: Whole<u32> = 250, 1..=100_000;
        /// Masks of targets beside their boxes.
        masks: bool = false, Any;
        /// Light of a target over the noise of a pixel from which on the pixel is the target's.
        mask_snr: f64 = 1.0, Within(1e-3, 1e3);
    }
}

fn drawn() -> Shape {
    Shape::either(Shape::Number(crate::check::Rule::Finite), Shape::Table(LAW))
}
