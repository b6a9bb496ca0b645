//! The table of variables -> `modelDescription.xml` of FMI 3.0.2 (sections 2.4 and 4.3 of the standard).

use crate::variables::{Kind, Role, Variable};
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
    /// Returns the version of a number; `None` for one that no unit is written for.
    pub fn of(number: u8) -> Option<Self> {
        match number {
            2 => Some(Self::Two),
            3 => Some(Self::Three),
            _ => None,
        }
    }

    /// Returns the name of the version.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Two => "2.0",
            Self::Three => "3.0",
        }
    }
}

/// Returns the description of a unit of FMI 3.
pub fn description(model: &Model, variables: &[Variable]) -> String {
    let mut out = String::new();
    opening(&mut out, model, "fmiVersion=\"3.0\"", "instantiationToken", "flat");
    line(
        &mut out,
        &format!(
            "  <CoSimulation modelIdentifier=\"{MODEL_IDENTIFIER}\" canHandleVariableCommunicationStepSize=\"true\" \
             canBeInstantiatedOnlyOncePerProcess=\"false\" canGetAndSetFMUState=\"false\" \
             canSerializeFMUState=\"false\" providesDirectionalDerivatives=\"false\" hasEventMode=\"false\" \
             canReturnEarlyAfterIntermediateUpdate=\"false\" providesIntermediateUpdate=\"false\"/>"
        ),
    );
    write_common(&mut out, model);
    line(&mut out, "  <ModelVariables>");
    variables.iter().for_each(|variable| write_variable(&mut out, variable));
    line(&mut out, "  </ModelVariables>");
    line(&mut out, "  <ModelStructure>");
    for element in ["Output", "InitialUnknown"] {
        for variable in variables.iter().filter(|variable| variable.role == Role::Output) {
            line(&mut out, &format!("    <{element} valueReference=\"{}\"/>", variable.reference));
        }
    }
    line(&mut out, "  </ModelStructure>");
    line(&mut out, "</fmiModelDescription>");
    out
}

/// Opens the description; the versions have different words for the token.
pub(crate) fn opening(out: &mut String, model: &Model, fmi_version: &str, token_word: &str, naming: &str) {
    let (name, token) = (escaped(&model.name), escaped(&model.token));
    let version = env!("CARGO_PKG_VERSION");
    line(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
    line(
        out,
        &format!(
            "<fmiModelDescription {fmi_version} modelName=\"{name}\" {token_word}=\"{token}\" \
             description=\"Star sensor stimulator: attitude in, frames and star tracker out\" version=\"{version}\" \
             license=\"MIT OR Apache-2.0\" generationTool=\"starloop {version}\" variableNamingConvention=\"{naming}\">"
        ),
    );
}

/// Writes units, categories of messages and the experiment, which both versions write alike.
pub(crate) fn write_common(out: &mut String, model: &Model) {
    write_units(out);
    line(out, "  <LogCategories>");
    line(out, "    <Category name=\"logStatusError\" description=\"Why a call failed\"/>");
    line(out, "    <Category name=\"logEvents\" description=\"How the run ended\"/>");
    line(out, "  </LogCategories>");
    let Model { stop_s, step_s, .. } = model;
    line(out, &format!("  <DefaultExperiment startTime=\"0\" stopTime=\"{stop_s}\" stepSize=\"{step_s}\"/>"));
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
pub(crate) fn words_of(variable: &Variable) -> (String, String) {
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

pub(crate) fn line(out: &mut String, text: &str) {
    out.push_str(text);
    out.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variables::variables;

    fn of(name: &str, heads: usize) -> String {
        let model = Model { name: name.into(), token: "{1}".into(), stop_s: 10.0, step_s: 0.1 };
        description(&model, &variables(heads))
    }

    #[test]
    fn every_variable_is_declared_and_every_output_is_in_the_structure() {
        let text = of("a \"b\" & <c>", 3);
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
        let text = of("bench", 1);
        let document = roxmltree::Document::parse(&text).unwrap();
        let defined: Vec<_> = document
            .descendants()
            .filter(|node| node.has_tag_name("Unit"))
            .filter_map(|n| n.attribute("name"))
            .collect();
        let used: Vec<_> = document.descendants().filter_map(|node| node.attribute("unit")).collect();
        assert!(!used.is_empty() && used.iter().all(|unit| defined.contains(unit)), "{used:?} of {defined:?}");
    }
}
