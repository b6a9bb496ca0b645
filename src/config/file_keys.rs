//! Kind of a file -> all that is declared of its keys.

use crate::{
    bench::BenchKeys, camera::CameraKeys, data_set_keys::DataSetKeys, declared::Declared, file_kind::FileKind,
    key::Section, link_keys::LinkTable, requirement_keys::RequirementKeys, scenario::ScenarioKeys,
    spacecraft::SpacecraftKeys, test_plan_keys::PlanKeys,
};

/// Returns all keys of a kind of files.
pub(super) fn declared(kind: FileKind) -> Declared {
    match kind {
        FileKind::Bench => BenchKeys::declared(),
        FileKind::Scenario => ScenarioKeys::declared(),
        FileKind::Camera => CameraKeys::declared(),
        FileKind::Link => LinkTable::declared(),
        FileKind::Spacecraft => SpacecraftKeys::declared(),
        FileKind::TestPlan => PlanKeys::declared(),
        FileKind::Requirements => RequirementKeys::declared(),
        FileKind::DataSet => DataSetKeys::declared(),
    }
}
