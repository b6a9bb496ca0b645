//! The table of variables -> `modelDescription.xml` of FMI 3.0.2 (sections 2.4 and 4.3 of the standard) or FMI 2.0.4 (2.2 and
//! 4.3.1 of that one).
//!
//! FMI 2 has no arrays: each number of one is a variable of its own, `rate[1]` to `rate[3]`, by the standard's structured
//! names. Whole numbers are Integers of 32 bits there.

use crate::variables::{Kind, Role, Variable, scalars};
use base::xml::escaped;

/// Name of the library in the archive, without its ending.
pub const MODEL_IDENTIFIER: &str = "starloop";

/// Content of the description beside the variables.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Name of the run.
    pub name: String,
    /// Instantiation token, which ties the description to the resources.
    pub token: String,
    /// Length of the run, s.
    pub stop_s: f64,
    /// Length of a step that suits it, s.
    pub step_s: f64,
}

/// Version of FMI that a unit is written for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FmiVersion {
    /// FMI 2.0: variables are single numbers.
    Two,
    /// FMI 3.0: vectors are arrays.
    Three,
}

impl FmiVersion {
    /// Returns the name of the version.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Two => "2.0",
            Self::Three => "3.0",
        }
    }
}

/// Returns the description of a unit.
pub fn description(model: &Model, version: FmiVersion, variables: &[Variable]) -> String {
    let mut out = String::new();
    write_opening(&mut out, model, version);
    write_units(&mut out);
    line(&mut out, "  <LogCategories>");
    line(&mut out, "    <Category name=\"logStatusError\" description=\"Why a call failed\"/>");
    line(&mut out, "    <Category name=\"logEvents\" description=\"How the run ended\"/>");
    line(&mut out, "  </LogCategories>");
    let Model { stop_s, step_s, .. } = model;
    line(&mut out, &format!("  <DefaultExperiment startTime=\"0\" stopTime=\"{stop_s}\" stepSize=\"{step_s}\"/>"));
    match version {
        FmiVersion::Two => write_variables_2(&mut out, &scalars(variables)),
        FmiVersion::Three => write_variables_3(&mut out, variables),
    }
    line(&mut out, "</fmiModelDescription>");
    out
}

fn write_opening(out: &mut String, model: &Model, version: FmiVersion) {
    let (name, token) = (escaped(&model.name), escaped(&model.token));
    let (program, fmi) = (env!("CARGO_PKG_VERSION"), version.name());
    let (token_word, naming, denied) = match version {
        FmiVersion::Two => (
            "guid",
            "structured",
            "canNotUseMemoryManagementFunctions=\"true\" canGetAndSetFMUstate=\"false\" \
             canSerializeFMUstate=\"false\" providesDirectionalDerivative=\"false\"",
        ),
        FmiVersion::Three => (
            "instantiationToken",
            "flat",
            "canGetAndSetFMUState=\"false\" canSerializeFMUState=\"false\" providesDirectionalDerivatives=\"false\" \
             hasEventMode=\"false\" canReturnEarlyAfterIntermediateUpdate=\"false\" providesIntermediateUpdate=\"false\"",
        ),
    };
    line(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
    line(
        out,
        &format!(
            "<fmiModelDescription fmiVersion=\"{fmi}\" modelName=\"{name}\" {token_word}=\"{token}\" \
             description=\"Star sensor stimulator: attitude in, frames and star tracker out\" version=\"{program}\" \
             license=\"MIT OR Apache-2.0\" generationTool=\"starloop {program}\" variableNamingConvention=\"{naming}\">"
        ),
    );
    line(
        out,
        &format!(
            "  <CoSimulation modelIdentifier=\"{MODEL_IDENTIFIER}\" canHandleVariableCommunicationStepSize=\"true\" \
             canBeInstantiatedOnlyOncePerProcess=\"false\" {denied}/>"
        ),
    );
}

fn write_units(out: &mut String) {
    line(out, "  <UnitDefinitions>");
    for (unit, base) in [
        ("s", "s=\"1\""),
        ("m", "m=\"1\""),
        ("m/s", "m=\"1\" s=\"-1\""),
        ("rad", "rad=\"1\""),
        ("rad/s", "rad=\"1\" s=\"-1\""),
        ("rad/s2", "rad=\"1\" s=\"-2\""),
    ] {
        line(out, &format!("    <Unit name=\"{unit}\"><BaseUnit {base}/></Unit>"));
    }
    line(out, "  </UnitDefinitions>");
}

/// Returns the words about a variable, and those about its value.
fn words_of(variable: &Variable) -> (String, String) {
    let (causality, variability) = match variable.role {
        Role::Time => ("independent", "continuous"),
        Role::Parameter => ("parameter", "fixed"),
        Role::Input => ("input", "discrete"),
        Role::Output => ("output", "discrete"),
    };
    let words = format!(
        "name=\"{}\" valueReference=\"{}\" causality=\"{causality}\" variability=\"{variability}\" description=\"{}\"",
        escaped(&variable.name),
        variable.reference,
        escaped(&variable.description)
    );
    let unit = variable.unit.map(|unit| format!(" unit=\"{unit}\""));
    let start = variable.start.as_deref().map(|start| format!(" start=\"{}\"", escaped(start)));
    (words, [unit, start].into_iter().flatten().collect())
}

/// Writes variables, and which of them are outputs: by reference.
fn write_variables_3(out: &mut String, variables: &[Variable]) {
    line(out, "  <ModelVariables>");
    variables.iter().for_each(|variable| write_variable(out, variable));
    line(out, "  </ModelVariables>");
    line(out, "  <ModelStructure>");
    for element in ["Output", "InitialUnknown"] {
        for variable in variables.iter().filter(|variable| variable.role == Role::Output) {
            line(out, &format!("    <{element} valueReference=\"{}\"/>", variable.reference));
        }
    }
    line(out, "  </ModelStructure>");
}

/// Writes variables, and which of them are outputs: by place.
fn write_variables_2(out: &mut String, variables: &[Variable]) {
    line(out, "  <ModelVariables>");
    for variable in variables {
        let element = match variable.kind {
            Kind::Float64 => "Real",
            Kind::Int32 | Kind::UInt16 | Kind::UInt32 | Kind::UInt64 => "Integer",
            Kind::Boolean => "Boolean",
            Kind::String => "String",
        };
        let (words, of_value) = words_of(variable);
        line(out, &format!("    <ScalarVariable {words}><{element}{of_value}/></ScalarVariable>"));
    }
    line(out, "  </ModelVariables>");
    line(out, "  <ModelStructure>");
    for list in ["Outputs", "InitialUnknowns"] {
        line(out, &format!("    <{list}>"));
        for (place, _output) in (1..).zip(variables).filter(|(_, variable)| variable.role == Role::Output) {
            line(out, &format!("      <Unknown index=\"{place}\"/>"));
        }
        line(out, &format!("    </{list}>"));
    }
    line(out, "  </ModelStructure>");
}

fn write_variable(out: &mut String, variable: &Variable) {
    let element = element(variable.kind);
    let (words, mut of_value) = words_of(variable);
    let mut inner = variable.elements.map(|count| format!("<Dimension start=\"{count}\"/>")).unwrap_or_default();
    // A text's start is an element of its own, and texts have no unit.
    if let Some(start) = variable.start.as_deref().filter(|_| variable.kind == Kind::String) {
        inner = format!("<Start value=\"{}\"/>", escaped(start));
        of_value.clear();
    }
    let head = format!("    <{element} {words}{of_value}");
    line(out, &if inner.is_empty() { format!("{head}/>") } else { format!("{head}>{inner}</{element}>") });
}

const fn element(kind: Kind) -> &'static str {
    match kind {
        Kind::Float64 => "Float64",
        Kind::Int32 => "Int32",
        Kind::UInt16 => "UInt16",
        Kind::UInt32 => "UInt32",
        Kind::UInt64 => "UInt64",
        Kind::Boolean => "Boolean",
        Kind::String => "String",
    }
}

fn line(out: &mut String, text: &str) {
    out.push_str(text);
    out.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variables::{element_of, reference, variables};

    fn of(name: &str, version: FmiVersion, heads: usize) -> String {
        let model = Model { name: name.into(), token: "{1}".into(), stop_s: 10.0, step_s: 0.1 };
        description(&model, version, &variables(heads))
    }

    #[test]
    fn every_variable_is_declared_and_every_output_is_in_the_structure() {
        let text = of("a \"b\" & <c>", FmiVersion::Three, 3);
        let document = roxmltree::Document::parse(&text).unwrap();
        assert_eq!(document.root_element().attribute("modelName"), Some("a \"b\" & <c>"));
        let of_tag = |tag: &str| document.descendants().filter(|node| node.has_tag_name(tag)).count();
        let declared = document.descendants().filter(|node| node.has_attribute("causality")).count();
        let outputs = variables(3).iter().filter(|variable| variable.role == Role::Output).count();
        assert_eq!(declared, variables(3).len());
        assert_eq!((of_tag("Output"), of_tag("InitialUnknown")), (outputs, outputs));
    }

    #[test]
    fn units_that_variables_use_are_defined() {
        let text = of("bench", FmiVersion::Three, 1);
        let document = roxmltree::Document::parse(&text).unwrap();
        let defined: Vec<_> = document
            .descendants()
            .filter(|node| node.has_tag_name("Unit"))
            .filter_map(|n| n.attribute("name"))
            .collect();
        let used: Vec<_> = document.descendants().filter_map(|node| node.attribute("unit")).collect();
        assert!(!used.is_empty() && used.iter().all(|unit| defined.contains(unit)), "{used:?} of {defined:?}");
    }

    #[test]
    fn every_number_is_a_variable_and_every_output_is_in_the_structure() {
        let text = of("a", FmiVersion::Two, 2);
        let document = roxmltree::Document::parse(&text).unwrap();
        let all: Vec<_> = document.descendants().filter(|node| node.has_tag_name("ScalarVariable")).collect();
        let numbers: usize = variables(2).iter().map(|variable| variable.elements.unwrap_or(1)).sum();
        assert_eq!((all.len(), document.root_element().attribute("guid")), (numbers, Some("{1}")));
        let outputs = all.iter().filter(|node| node.attribute("causality") == Some("output")).count();
        let unknown: Vec<usize> = document
            .descendants()
            .filter(|node| node.has_tag_name("Unknown"))
            .map(|node| node.attribute("index").unwrap().parse().unwrap())
            .collect();
        assert_eq!(unknown.len(), 2 * outputs);
        assert!(unknown.iter().all(|place| all[place - 1].attribute("causality") == Some("output")));
        let first = all.iter().find(|node| node.attribute("name") == Some("q_body_from_icrf[1]")).unwrap();
        let number = first.attribute("valueReference").unwrap().parse().unwrap();
        assert_eq!(element_of(number), (reference::Q_BODY_FROM_ICRF, Some(0)));
        let starts = first.first_element_child().unwrap().attribute("start");
        assert_eq!(starts, Some("1"), "the scalar part of the identity");
    }
}
