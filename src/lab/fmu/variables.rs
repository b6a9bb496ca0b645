//! Every variable of a unit: name, reference, type, unit, meaning. Description and C interface read this table.
//!
//! Vectors are arrays. A quaternion is scalar first, Hamilton, passive: `v_body = q v_icrf q*`; another sense or order
//! must be converted before it is set. Quaternions are discrete: importers interpolate continuous inputs component by
//! component.

/// Type of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Double precision.
    Float64,
    /// Whole number of 32 bits.
    Int32,
    /// Whole number of 16 bits, not negative.
    UInt16,
    /// Whole number of 32 bits, not negative.
    UInt32,
    /// Whole number of 64 bits, not negative.
    UInt64,
    /// True or false.
    Boolean,
    /// Text.
    String,
}

/// When a variable is set or read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Simulated time.
    Time,
    /// Set before the start.
    Parameter,
    /// Set before each step.
    Input,
    /// Read after each step.
    Output,
}

/// A variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Name in the description.
    pub name: String,
    /// Value reference.
    pub reference: u32,
    /// Type.
    pub kind: Kind,
    /// When it is set or read.
    pub role: Role,
    /// Number of elements of an array; `None` for a single value.
    pub elements: Option<usize>,
    /// Unit, where it has one.
    pub unit: Option<&'static str>,
    /// Value before the start, as the description writes it; `None` for what has none by the standard.
    pub start: Option<String>,
    /// Meaning, for people.
    pub description: String,
}

/// References of the variables that are there once.
pub mod reference {
    /// Time, s.
    pub const TIME: u32 = 0;
    /// Folder for frames and reports.
    pub const OUTPUT_DIR: u32 = 1;
    /// Attitude, w x y z.
    pub const Q_BODY_FROM_ICRF: u32 = 10;
    /// Rate, rad/s.
    pub const RATE: u32 = 11;
    /// Acceleration, rad/s^2.
    pub const ACCELERATION: u32 = 12;
    /// Rotation of the line of sight, rad.
    pub const JITTER: u32 = 13;
    /// Position, m.
    pub const POSITION: u32 = 14;
    /// Velocity, m/s.
    pub const VELOCITY: u32 = 15;
    /// Whether position and velocity are used.
    pub const HAS_OBSERVER: u32 = 16;
    /// Number of the trigger.
    pub const TRIGGER: u32 = 17;
    /// How often it fired.
    pub const TRIGGER_COUNT: u32 = 18;
    /// Samples that were refused.
    pub const REFUSED: u32 = 20;
    /// Of the first head; further heads follow [`HEAD_STRIDE`] apart.
    pub const HEADS: u32 = 100;
    /// From one head's variables to the next's.
    pub const HEAD_STRIDE: u32 = 100;
    /// Within a head: number of frames.
    pub const FRAMES: u32 = 0;
    /// Within a head: middle of the newest frame's exposure, s.
    pub const MID_EXPOSURE: u32 = 1;
    /// Within a head: true attitude then.
    pub const TRUTH: u32 = 2;
    /// Within a head: stars drawn in it.
    pub const STARS: u32 = 3;
    /// Within a head: the tracker's attitude.
    pub const TRACKER_Q: u32 = 4;
    /// Within a head: whether it is valid.
    pub const TRACKER_VALID: u32 = 5;
    /// Within a head: stars that the tracker matched.
    pub const TRACKER_STARS: u32 = 6;
    /// Within a head: middle of the exposure that the tracker measured, s.
    pub const TRACKER_TIME: u32 = 7;
    /// Within a head: the jitter that was drawn.
    pub const TRUE_JITTER: u32 = 8;
}

const IDENTITY: &str = "1 0 0 0";
const ZEROS: &str = "0 0 0";

/// Returns a single variable without unit and start.
fn variable(name: impl Into<String>, reference: u32, kind: Kind, role: Role, description: &str) -> Variable {
    let (name, description) = (name.into(), description.into());
    Variable { name, reference, kind, role, elements: None, unit: None, start: None, description }
}

/// Returns every variable of a unit with so many heads.
pub fn variables(heads: usize) -> Vec<Variable> {
    let time = variable("time", reference::TIME, Kind::Float64, Role::Time, "Time since the first exposure begins");
    let folder = "New folder for the frames and tables of the run; empty: frames are drawn and not kept";
    let folder = variable("output_dir", reference::OUTPUT_DIR, Kind::String, Role::Parameter, folder);
    let refused = "Inputs that were refused, such as an attitude that jumps";
    let mut all = vec![Variable { unit: Some("s"), ..time }, Variable { start: Some("starloop_fmu".into()), ..folder }];
    all.extend(inputs());
    all.push(variable("refused_samples", reference::REFUSED, Kind::UInt64, Role::Output, refused));
    (0..heads).for_each(|head| all.extend(of_head(head, heads)));
    all
}

fn inputs() -> Vec<Variable> {
    let vector = |name: &str, reference, unit, start: &str, description: &str| Variable {
        elements: Some(start.split(' ').count()),
        unit,
        start: Some(start.into()),
        ..variable(name, reference, Kind::Float64, Role::Input, description)
    };
    let single = |name: &str, reference, kind, start: &str, description: &str| Variable {
        start: Some(start.into()),
        ..variable(name, reference, kind, Role::Input, description)
    };
    vec![
        vector(
            "q_body_from_icrf",
            reference::Q_BODY_FROM_ICRF,
            None,
            IDENTITY,
            "Attitude at the start of the step: w x y z, Hamilton, passive, v_body = q v_icrf q*",
        ),
        vector("rate", reference::RATE, Some("rad/s"), ZEROS, "Angular rate with respect to ICRF, body axes"),
        vector(
            "acceleration",
            reference::ACCELERATION,
            Some("rad/s2"),
            ZEROS,
            "Angular acceleration, body axes; zeros where it is not known",
        ),
        vector(
            "jitter",
            reference::JITTER,
            Some("rad"),
            ZEROS,
            "Rotation vector of the line of sight beside the attitude, body axes",
        ),
        vector(
            "position",
            reference::POSITION,
            Some("m"),
            ZEROS,
            "Position from the centre of the body that the observer is about, ICRF axes",
        ),
        vector("velocity", reference::VELOCITY, Some("m/s"), ZEROS, "Velocity likewise"),
        single(
            "has_observer",
            reference::HAS_OBSERVER,
            Kind::Boolean,
            "false",
            "True: position and velocity are used; false: the orbit of the run file",
        ),
        single("trigger", reference::TRIGGER, Kind::UInt16, "0", "Number of the trigger that fires"),
        single(
            "trigger_count",
            reference::TRIGGER_COUNT,
            Kind::UInt32,
            "0",
            "The trigger fires at the start of a step for which this has risen",
        ),
    ]
}

/// Returns the outputs of a head, counted from 0; the names of a single head have no number.
fn of_head(head: usize, heads: usize) -> Vec<Variable> {
    let prefix = if heads == 1 { String::new() } else { format!("head_{head}_") };
    let first = reference::HEADS + reference::HEAD_STRIDE * u32::try_from(head).unwrap_or(u32::MAX / 200);
    let output = |name: &str, reference: u32, kind, elements, unit, description: &str| Variable {
        elements,
        unit,
        ..variable(format!("{prefix}{name}"), first + reference, kind, Role::Output, description)
    };
    let (four, float) = (Some(4), Kind::Float64);
    vec![
        output("frame_counter", reference::FRAMES, Kind::UInt64, None, None, "Frames delivered so far"),
        output(
            "mid_exposure",
            reference::MID_EXPOSURE,
            float,
            None,
            Some("s"),
            "Middle of the exposure of the newest frame",
        ),
        output(
            "true_q_sensor_from_icrf",
            reference::TRUTH,
            float,
            four,
            None,
            "Attitude of the sensor that the newest frame was drawn from, at mid-exposure",
        ),
        output(
            "true_jitter",
            reference::TRUE_JITTER,
            float,
            Some(3),
            Some("rad"),
            "Rotation vector of the line of sight beside that attitude that was drawn, at mid-exposure, sensor axes",
        ),
        output("star_count", reference::STARS, Kind::Int32, None, None, "Stars drawn in the newest frame"),
        output(
            "tracker_q_sensor_from_icrf",
            reference::TRACKER_Q,
            float,
            four,
            None,
            "Attitude that the built-in star tracker measured on the pixels of the newest frame that it has done",
        ),
        output("tracker_valid", reference::TRACKER_VALID, Kind::Boolean, None, None, "Whether that attitude is valid"),
        output("tracker_stars", reference::TRACKER_STARS, Kind::Int32, None, None, "Stars that it matched"),
        output(
            "tracker_time",
            reference::TRACKER_TIME,
            float,
            None,
            Some("s"),
            "Middle of the exposure that it measured",
        ),
    ]
}

/// From the reference of a variable to that of its first element, and from one element to the next.
const ELEMENT_STRIDE: u32 = 1_000_000;

/// Returns the variables with each number of an array as one of its own: `rate[1]`, `rate[2]`, `rate[3]`.
pub(crate) fn scalars(variables: &[Variable]) -> Vec<Variable> {
    let elements_of = |variable: &Variable| {
        let starts: Vec<_> = variable.start.iter().flat_map(|start| start.split(' ').map(str::to_owned)).collect();
        let element = |number: usize| Variable {
            name: format!("{}[{number}]", variable.name),
            reference: variable.reference + ELEMENT_STRIDE * number as u32,
            elements: None,
            start: starts.get(number - 1).cloned(),
            ..variable.clone()
        };
        match variable.elements {
            Some(count) => (1..=count).map(element).collect(),
            None => vec![variable.clone()],
        }
    };
    variables.iter().flat_map(elements_of).collect()
}

/// Returns the reference of the variable that is meant, and which of its elements, counted from 0; `None`: all of it.
pub(crate) fn element_of(reference: u32) -> (u32, Option<usize>) {
    (reference % ELEMENT_STRIDE, (reference as usize / ELEMENT_STRIDE as usize).checked_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_and_references_are_unique() {
        for heads in [1, 3] {
            let all = variables(heads);
            let names: BTreeSet<_> = all.iter().map(|variable| &variable.name).collect();
            let references: BTreeSet<_> = all.iter().map(|variable| variable.reference).collect();
            assert_eq!((names.len(), references.len()), (all.len(), all.len()));
        }
    }

    #[test]
    fn an_element_leads_back_to_its_array() {
        let single = scalars(&variables(2));
        let references: BTreeSet<_> = single.iter().map(|variable| variable.reference).collect();
        assert_eq!(references.len(), single.len());
        let rate: Vec<_> = single.iter().filter(|variable| variable.name.starts_with("rate[")).collect();
        let places: Vec<_> = rate.iter().map(|variable| element_of(variable.reference)).collect();
        assert_eq!(places, [0, 1, 2].map(|place| (reference::RATE, Some(place))));
        assert_eq!(element_of(reference::RATE), (reference::RATE, None), "the array itself");
        assert!(rate.iter().all(|variable| variable.start.as_deref() == Some("0")));
    }

    #[test]
    fn a_start_value_has_as_many_numbers_as_the_array() {
        for variable in variables(2).into_iter().chain(scalars(&variables(2))) {
            let numbers = variable.start.as_ref().filter(|_| variable.elements.is_some()).map(|s| s.split(' ').count());
            assert!(numbers.is_none() || numbers == variable.elements, "{}", variable.name);
            assert_eq!(variable.start.is_some(), matches!(variable.role, Role::Input | Role::Parameter));
        }
    }
}
