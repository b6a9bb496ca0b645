//! Keys of test plans of star trackers and of files of requirements: declared here for reference, schema, templates and
//! the check of keys. What they mean together is checked by those who fly them.
//!
//! Keys of descriptions of data sets, too; distributions are checked by those who draw from them.
#![allow(dead_code, reason = "crates above read the values of these keys, after their check")]

use crate::key_type::{Any, Numbers, Raw, Shape, Whole, Word};
use crate::{declared::Presence, key::section};
use serde::Deserialize;

/// `axes`: an axis map, or a quaternion.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "invalid type: expected an axis map or a quaternion")]
pub(super) enum AxesKey {
    Map(String),
    Quaternion([f64; 4]),
}

section! {
    /// A test plan.
    PlanKeys at "" {
        /// Its name, in the title of the report.
        name: String = Needed, "text";
        /// Camera of all cases.
        camera: String = Needed, "path";
        /// Seed of attitudes, detector and noise.
        seed: Whole<u64> = 1, 0..=i64::MAX;
        /// Start of every case, UTC.
        start_utc: String = "2026-03-01T00:00:00Z", "time as RFC 3339";
        /// Frames per second, where a case says no other.
        frame_rate_hz: f64 = 5.0, Within(0.001, 1000.0);
        /// Confidence of intervals.
        confidence: f64 = 0.95, Within(0.5, 0.999_999);
        /// Probability at which performances are stated.
        probability: f64 = 0.997, Within(0.5, 0.999_999);
        /// Arcseconds across the boresight beyond which a solution is false.
        false_directional_arcsec: f64 = 360.0, Within(1e-3, 648_000.0);
        /// Arcseconds about the boresight beyond which a solution is false.
        false_rotational_arcsec: f64 = 3600.0, Within(1e-3, 648_000.0);
        /// Largest temporal noise per axis across the boresight at an exclusion angle.
        exclusion_noise_arcsec: f64 = Optional, Within(1e-6, 648_000.0);
        /// File of requirements.
        requirements: String = Optional, "path";
        /// Values that are changed in the run file of every case; no sinks: frames go to the tracker.
        set: Raw<Vec<String>> = Optional, Shape::list(Shape::Text("KEY=VALUE"));
        tables:
        /// Names for the head of the report.
        document: Option<DocumentKeys>;
        /// The tracker under test.
        tracker: TestedTrackerKeys;
        /// A case, or one for each value of a sweep.
        case: NeededList<CaseKeys>;
    }

    /// Names for the head of the report.
    DocumentKeys at "document" {
        /// The unit under test.
        unit: String = Optional, "text";
        /// Its serial number.
        serial_number: String = Optional, "text";
        /// The person who made the test and the report.
        author: String = Optional, "text";
        /// Date of the test.
        date_of_test: String = Computed("the day of the flight"), "text";
    }

    /// The tracker under test.
    TestedTrackerKeys at "tracker" {
        /// The built-in tracker, which sees pixels only; a program outside, which gets a folder of images; or a statistical
        /// model, which sees the truth.
        source: Word<()> = "built_in", [("built_in", ()), ("program", ()), ("model", ())];
        /// Its name in the report.
        name: String = Computed("the kind of tracker, or the program's name"), "text";
        /// Most stars that the built-in tracker measures.
        stars: Whole<u32> = 40, 1..=10_000;
        /// Milliseconds that a tracker inside thinks.
        delay_ms: f64 = 50.0, Within(0.0, 10_000.0);
        /// Milliseconds by which time tags of a tracker inside are late: a date error to be studied.
        tag_error_ms: f64 = 0.0, Within(-1000.0, 1000.0);
        /// A program and its arguments, with source = "program": {frames} is the folder of images, {camera} the camera
        /// file, {log} the log that it writes.
        command: Raw<Vec<String>> = Optional, Shape::list(Shape::Text("word"));
        /// Convention of the roll in the log of a program outside, by its own word or by a program that has it.
        roll: Word<()> = Optional, [
            ("up", ()), ("starloop", ()), ("lost", ()), ("north", ()), ("tetra3", ()), ("cedar-solve", ()), ("down", ()),
            ("astrometry", ()), ("openstartracker", ()), ("tetra3rs", ()),
        ];
        /// Axes of a program outside along image right, image down and the boresight, such as "-y -z x"; or the quaternion
        /// w, x, y, z from its axes to the sensor's.
        axes: Raw<AxesKey> = Optional, Shape::either(Shape::Text("axis map"), Shape::numbers(4));
        /// Figures of the statistical tracker, with source = "model".
        model: Raw<toml::Table> = Optional, Shape::Table("the keys of [tracker_out.model], and earth_exclusion_deg");
    }

    /// A case.
    CaseKeys at "case" {
        /// Its name; a sweep adds its value.
        name: String = Needed, "text";
        /// Purpose, which decides its metrics.
        r#use: Word<()> = Needed, [
            ("lost_in_space", ()), ("inertial", ()), ("fov_grid", ()), ("pixel_grid", ()), ("slew", ()), ("stress", ()),
            ("drift", ()), ("thermo_elastic", ()), ("bandwidth", ()), ("run", ()),
        ];
        /// Frames of each attitude.
        frames: Whole<u32> = Needed, 1..=10_000_000;
        /// Frames per second.
        frame_rate_hz: f64 = Computed("the plan's"), Within(0.001, 1000.0);
        /// Degrees per second about the sensor's axes from each attitude on.
        rate_deg_s: [f64; 3] = Numbers([0.0; 3]), Within(-100.0, 100.0);
        /// Acceleration about the axis of the rate.
        acceleration_deg_s2: [f64; 3] = Numbers([0.0; 3]), Within(-100.0, 100.0);
        /// Amplitude of a sine of the line of sight about the sensor's axes, with use = "bandwidth".
        sine_arcsec: [f64; 3] = Numbers([0.0; 3]), Within(-3600.0, 3600.0);
        /// Its frequency.
        sine_hz: f64 = 1.0, Within(1e-3, 1e3);
        /// Values that are changed in the run file; {value} is that of the sweep.
        set: Raw<Vec<String>> = Optional, Shape::list(Shape::Text("KEY=VALUE"));
        tables:
        /// Where the sensor points.
        attitudes: PointingKeys;
        /// Turn of the sensor by sin^2(pi t / P) of these angles, from the cold end of an orbit to the hot one.
        mounting_drift: Option<MountingDriftKeys>;
        /// Several cases that differ in one value.
        sweep: Option<SweepKeys>;
    }

    /// Where the sensor points.
    PointingKeys at "case.attitudes" {
        /// How they are chosen: one; a grid of directions; shifts by parts of a pixel; all over the sky; at the sweep's angle
        /// from a body.
        kind: Word<()> = Needed, [
            ("fixed", ()), ("grid", ()), ("shifts", ()), ("uniform", ()), ("from_sun", ()), ("from_moon", ()), ("from_earth", ()),
        ];
        /// Right ascension of fixed, grid and shifts.
        ra_deg: f64 = Optional, Finite;
        /// Declination of these.
        dec_deg: f64 = Optional, Within(-90.0, 90.0);
        /// Position angle of image up, east of north.
        roll_deg: f64 = 0.0, Finite;
        /// Attitudes along each side of a grid or of shifts.
        steps: Whole<u32> = Optional, 1..=316;
        /// Length of a side of a grid.
        span_deg: f64 = Optional, Finite;
        /// From one shift to the next.
        step_px: f64 = Optional, Finite;
        /// Attitudes of uniform, from_sun, from_moon and from_earth.
        count: Whole<u32> = Optional, 1..=100_000;
    }

    /// Drift of the mounting.
    MountingDriftKeys at "case.mounting_drift" {
        /// Largest turn about the sensor's axes.
        arcsec: [f64; 3] = Needed, Within(-3600.0, 3600.0);
        /// Seconds of an orbit, from cold to hot and back.
        period_s: f64 = Needed, Within(1.0, 1e9);
    }

    /// Values of one thing.
    SweepKeys at "case.sweep" {
        /// Its name with unit, for plots.
        key: String = Needed, "text";
        /// Quantity that the value multiplies; nothing: it is only put in the place of {value} in set.
        scales: Word<()> = "nothing", [("nothing", ()), ("rate", ()), ("acceleration", ()), ("frequency", ())];
        /// The values, one for each case.
        values: Raw<Vec<f64>> = Needed, Shape::list(Shape::Number(Finite));
    }
}

/// A list of one table at least.
#[derive(Debug, Clone, Default, serde::Deserialize)]
#[serde(transparent)]
pub(super) struct NeededList<S>(Vec<S>);

impl<S: crate::key::Section> crate::key::Inner for NeededList<S> {
    const PRESENCE: Presence = Presence::NeededList;
    fn forms() -> Vec<crate::declared::Declared> {
        vec![S::declared()]
    }
}

section! {
    /// Requirements on a star tracker.
    RequirementKeys at "" {
        tables:
        /// A limit of one metric.
        requirement: NeededList<LimitKeys>;
    }

    /// A limit of one metric.
    LimitKeys at "requirement" {
        /// Identifier, as in your specification.
        id: String = Needed, "text";
        /// Its words.
        text: String = "", "text";
        /// The metric, such as temporal_noise.x; src/guide/metrics.md lists all.
        metric: String = Needed, "name of a metric";
        /// Largest magnitude that is met, in the metric's unit; this or least.
        most: f64 = Optional, Finite;
        /// Least value that is met, in the metric's unit; this or most.
        least: f64 = Optional, Finite;
        /// The case, of a metric that each case has for itself.
        case: String = Optional, "name of a case";
        /// Part that is compared with the limit: the interval, or the measured value alone.
        by: Word<()> = "interval", [("interval", ()), ("value", ())];
    }
}

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
