//! Kind of a file -> all that is declared of its keys.

use crate::bench::BenchKeys;
use crate::camera::CameraKeys;
use crate::data_set_keys::DataSetKeys;
use crate::declared::Declared;
use crate::file_kind::FileKind;
use crate::key::Section;
use crate::link_keys::LinkTable;
use crate::requirement_keys::RequirementKeys;
use crate::scenario::ScenarioKeys;
use crate::spacecraft::SpacecraftKeys;
use crate::test_plan_keys::PlanKeys;

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
