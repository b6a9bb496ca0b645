//! Facts as JSON.

use super::row::{Key, Row};
use super::table::TABLE;
use super::value::{Fact, FactSource, Form, Scalar};
use serde_json::{Map, Value, json as value};

/// Returns an object with the facts of one output: those for which `keys` finds keys in a row.
pub fn json_keys(source: &FactSource<'_>, keys: impl Fn(&Row) -> &'static [Key]) -> Map<String, Value> {
    let mut object = Map::new();
    for row in TABLE {
        for Key(key, form) in keys(row) {
            object.insert((*key).to_owned(), json((row.value)(source), *form));
        }
    }
    object
}

/// Returns a fact as JSON: lists as arrays, faults with their numbers as objects, regions as arrays of left, top, width
/// and height; `null` for values that are absent or not finite.
pub fn json(fact: Fact<'_>, form: Form) -> Value {
    match fact {
        Fact::Reals(all) => value!(all),
        Fact::Wholes(all) => value!(all),
        Fact::Faults(faults) if form == Form::Names => faults.names().collect(),
        Fact::Active(active) if form == Form::Plain => {
            let faults = active.named().iter().map(|fault| {
                let (amount, unit) = (fault.amount.value, fault.amount.unit);
                value!({ "name": fault.name, "number": fault.number, "value": amount, "unit": unit })
            });
            faults.collect()
        }
        Fact::Regions(regions) if form == Form::Plain => {
            let parts = regions
                .as_slice()
                .iter()
                .map(|part| value!([part.left_px, part.top_px, part.width_px, part.height_px]));
            parts.collect()
        }
        Fact::Absent
        | Fact::Flag(_)
        | Fact::U32(_)
        | Fact::U64(_)
        | Fact::Count(_)
        | Fact::Real(_)
        | Fact::Text(_)
        | Fact::Time(_)
        | Fact::Span(_)
        | Fact::Faults(_)
        | Fact::Active(_)
        | Fact::Regions(_) => scalar(fact.element(0, form)),
    }
}

fn scalar(element: Scalar<'_>) -> Value {
    match element {
        Scalar::Absent => Value::Null,
        Scalar::Flag(is_so) => is_so.into(),
        Scalar::Whole(number) => {
            u64::try_from(number).map_or_else(|_| i64::try_from(number).map_or(Value::Null, Value::from), Value::from)
        }
        Scalar::Real(number) => number.into(),
        Scalar::Text(text) => text.into(),
    }
}
