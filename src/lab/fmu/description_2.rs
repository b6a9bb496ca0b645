//! The table of variables -> `modelDescription.xml` of FMI 2.0.4 (sections 2.2 and 4.3.1 of that standard).
//!
//! FMI 2 has no arrays: each number of one is a variable of its own, `rate[1]` to `rate[3]`, by the standard's structured
//! names. Whole numbers are Integers of 32 bits.

use crate::description::{MODEL_IDENTIFIER, Model, line, opening, words_of, write_common};
use crate::variables::{Kind, Role, Variable, scalars};

/// Returns the description of a unit.
pub(crate) fn description(model: &Model, variables: &[Variable]) -> String {
    let mut out = String::new();
    opening(&mut out, model, "fmiVersion=\"2.0\"", "guid", "structured");
    line(
        &mut out,
        &format!(
            "  <CoSimulation modelIdentifier=\"{MODEL_IDENTIFIER}\" canHandleVariableCommunicationStepSize=\"true\" \
             canBeInstantiatedOnlyOncePerProcess=\"false\" canNotUseMemoryManagementFunctions=\"true\" \
             canGetAndSetFMUstate=\"false\" canSerializeFMUstate=\"false\" providesDirectionalDerivative=\"false\"/>"
        ),
    );
    write_common(&mut out, model);
    line(&mut out, "  <ModelVariables>");
    let scalars = scalars(variables);
    scalars.iter().for_each(|variable| write_variable(&mut out, variable));
    line(&mut out, "  </ModelVariables>");
    line(&mut out, "  <ModelStructure>");
    for list in ["Outputs", "InitialUnknowns"] {
        line(&mut out, &format!("    <{list}>"));
        for (place, _) in (1..).zip(&scalars).filter(|(_, variable)| variable.role == Role::Output) {
            line(&mut out, &format!("      <Unknown index=\"{place}\"/>"));
        }
        line(&mut out, &format!("    </{list}>"));
    }
    line(&mut out, "  </ModelStructure>");
    line(&mut out, "</fmiModelDescription>");
    out
}

fn write_variable(out: &mut String, variable: &Variable) {
    let element = match variable.kind {
        Kind::Float64 => "Real",
        Kind::Int32 | Kind::UInt16 | Kind::UInt32 | Kind::UInt64 => "Integer",
        Kind::Boolean => "Boolean",
        Kind::String => "String",
    };
    let (words, of_value) = words_of(variable);
    line(out, &format!("    <ScalarVariable {words}><{element}{of_value}/></ScalarVariable>"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variables::{element_of, reference, variables};

    #[test]
    fn every_number_is_a_variable_and_every_output_is_in_the_structure() {
        let model = Model { name: "a".into(), token: "{1}".into(), stop_s: 10.0, step_s: 0.1 };
        let text = description(&model, &variables(2));
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
        let second = all.iter().find(|node| node.attribute("name") == Some("q_body_from_icrf[1]")).unwrap();
        let number = second.attribute("valueReference").unwrap().parse().unwrap();
        assert_eq!(element_of(number), (reference::Q_BODY_FROM_ICRF, 0));
        let starts = second.first_element_child().unwrap().attribute("start");
        assert_eq!(starts, Some("1"), "the scalar part of the identity");
    }
}
