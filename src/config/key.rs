//! One declaration per key: its name, what it means, what it may be, what it is without a value, and what to try.
//!
//! [`section!`] makes three things of a list of declarations: the table as serde reads it, a method per key that checks
//! its value ([`Given`]), and the list that reference, schema and templates walk ([`Declared`]). A declaration is
//!
//! ```text
//! /// Integration time in seconds: 100 ms is 0.1.
//! exposure_s: f64 = 0.05, PositiveUpTo(3600.0);
//! ```
//!
//! the sentence, the name, the type ([`KeyType`]), the [`Preset`] and the limit. The sentence is also the advice of an
//! error, unless a text of its own follows the limit. A key that is declared and not read is dead code, which the
//! compiler reports; a key that is not declared cannot be read.

use crate::declared::{Declared, Presence, Preset};
use crate::error::{ConfigError, MISSING, Result};
use crate::{check::Checker, key_type::KeyType};
use base::time::Span;
use core::fmt;
use serde::de::DeserializeOwned;
use std::borrow::Cow;

/// A key as a file gives it, with its declaration.
#[derive(Debug)]
pub(super) struct Given<'k, T: KeyType> {
    /// Its table, as messages name it.
    pub(super) table: &'k str,
    pub(super) name: &'static str,
    pub(super) raw: Option<&'k T::Raw>,
    pub(super) preset: Preset<T::Default>,
    pub(super) limit: T::Limit,
    pub(super) advice: Cow<'static, str>,
}

impl<'k, T: KeyType> Given<'k, T> {
    /// Returns its name with its tables.
    pub(super) fn key(&self) -> String {
        if self.table.is_empty() { self.name.into() } else { format!("{}.{}", self.table, self.name) }
    }

    /// Returns whether the file gives it.
    pub(super) fn is_given(&self) -> bool {
        self.raw.is_some()
    }

    /// Returns the value that the file gives, unchecked.
    pub(super) fn raw(&self) -> Option<&'k T::Raw> {
        self.raw
    }

    /// Sets a default that follows from other keys.
    pub(super) fn or(self, default: impl Into<T::Default>) -> Self {
        Self { preset: Preset::Noted(default.into()), ..self }
    }

    /// Sets a default that follows from other keys, and is not listed.
    pub(super) fn or_silently(self, default: impl Into<T::Default>) -> Self {
        Self { preset: Preset::Silent(default.into()), ..self }
    }

    /// Sets a limit that follows from other keys.
    pub(super) fn within(self, limit: impl Into<T::Limit>) -> Self {
        Self { limit: limit.into(), ..self }
    }

    /// Sets other advice.
    pub(super) fn advised(self, advice: impl Into<Cow<'static, str>>) -> Self {
        Self { advice: advice.into(), ..self }
    }

    /// Returns the value that is given, or the default; checked.
    pub(super) fn check(self, check: &mut Checker<'_>) -> Result<T::Checked> {
        let default = match (self.raw, &self.preset) {
            (Some(raw), _) => return self.read(raw, check),
            (None, Preset::Noted(default)) => {
                check.note(&self.key(), default);
                default
            }
            (None, Preset::Silent(default)) => default,
            (None, Preset::Needed | Preset::Computed(_) | Preset::Optional) => {
                return Err(self.missing(T::wanted(&self.limit), check));
            }
        };
        self.read(&T::raw(default), check)
    }

    /// Returns the value that is given, checked; without one nothing.
    pub(super) fn optional(self, check: &Checker<'_>) -> Result<Option<T::Checked>> {
        self.raw.map(|raw| self.read(raw, check)).transpose()
    }

    fn read(&self, raw: &T::Raw, check: &Checker<'_>) -> Result<T::Checked> {
        T::read(raw, &self.limit)
            .map_err(|refusal| check.invalid(&self.key(), refusal.got, refusal.wanted, &self.advice))
    }

    /// Returns the error of a value that breaks a rule of its own, with the key's advice.
    pub(super) fn invalid(
        &self,
        got: impl fmt::Display,
        wanted: impl fmt::Display,
        check: &Checker<'_>,
    ) -> ConfigError {
        check.invalid(&self.key(), got, wanted, &self.advice)
    }

    /// Returns the error of a key that must be given.
    pub(super) fn missing(&self, wanted: impl fmt::Display, check: &Checker<'_>) -> ConfigError {
        self.invalid(MISSING, wanted, check)
    }
}

impl Given<'_, f64> {
    /// Returns the milliseconds that are given, or the default; checked.
    pub(super) fn ms(self, check: &mut Checker<'_>) -> Result<Span> {
        Ok(Span::from_s(self.check(check)? * 1e-3))
    }
}

/// Variables of the same names as keys, with their checked values.
macro_rules! taken {
    ($check:expr, $keys:expr => $($key:ident),+) => { $( let $key = $keys.$key().check($check)?; )+ };
}

/// A table of keys.
pub(super) trait Section: Clone + Default + DeserializeOwned {
    /// Returns its keys and tables, as they are declared.
    fn declared() -> Declared;

    /// Returns its place, as messages name it.
    fn table(&self) -> &str;

    /// Returns the same at another place, such as `target[2]`.
    fn at(&self, table: &str) -> Self;

    /// Returns its keys, and whether each is given.
    fn given(&self) -> Vec<(&'static str, bool)>;

    /// Refuses keys that have a meaning only with another choice, which `owner` names.
    fn refuse(&self, names: &[&str], owner: &str, check: &Checker<'_>) -> Result<()> {
        let given = self.given();
        let prefix = if self.table().is_empty() { String::new() } else { format!("{}.", self.table()) };
        for name in names {
            let is_given = given.iter().any(|(known, is_given)| known == name && *is_given);
            check.unused(&format!("{prefix}{name}"), is_given, owner)?;
        }
        Ok(())
    }
}

/// A table within a table.
pub(super) trait Inner {
    /// How often.
    const PRESENCE: Presence;
    /// Returns its forms: one, or one for each kind of it.
    fn forms() -> Vec<Declared>;
}

impl<S: Section> Inner for S {
    const PRESENCE: Presence = Presence::Once;
    fn forms() -> Vec<Declared> {
        vec![S::declared()]
    }
}

impl<S: Section> Inner for Option<S> {
    const PRESENCE: Presence = Presence::Optional;
    fn forms() -> Vec<Declared> {
        vec![S::declared()]
    }
}

impl<I: Inner> Inner for Vec<I> {
    const PRESENCE: Presence = match I::PRESENCE {
        Presence::OrFile => Presence::ListOrFiles,
        Presence::Once | Presence::Optional | Presence::List | Presence::ListOrFiles | Presence::NeededList => {
            Presence::List
        }
    };
    fn forms() -> Vec<Declared> {
        I::forms()
    }
}

/// Returns the tables of a list, each at its place.
pub(super) fn listed<S: Section>(tables: &[S], name: &str) -> Vec<S> {
    tables.iter().enumerate().map(|(place, table)| table.at(&format!("{name}[{place}]"))).collect()
}

/// Returns the advice of a key: a text of its own, or its sentence as a clause.
pub(super) fn advice(sentence: &'static str, own: &[&'static str]) -> Cow<'static, str> {
    if let Some(own) = own.first() {
        return (*own).into();
    }
    let sentence = sentence.trim().trim_end_matches('.');
    let mut rest = sentence.chars();
    match (rest.next(), rest.clone().next()) {
        (Some(first), Some(second)) if !second.is_uppercase() => {
            format!("{}{}", first.to_lowercase(), rest.as_str()).into()
        }
        _ => sentence.into(),
    }
}

/// Tables of keys: see the top of this file.
macro_rules! section {
    ($(
        $(#[doc = $about:literal])+
        $keys:ident at $place:literal {
            $(
                $(#[doc = $sentence:literal])+
                $key:ident: $type:ty = $preset:expr, $limit:expr $(, $advice:expr)?;
            )*
            $(tables: $( $(#[doc = $what:literal])+ $inner:ident: $nested:ty; )+)?
        }
    )+) => { $(
        $(#[doc = $about])+
        #[derive(Debug, Clone, Default, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub(super) struct $keys {
            #[serde(skip)]
            placed_at: Option<String>,
            $( $key: Option<<$type as $crate::key_type::KeyType>::Raw>, )*
            $($( pub(super) $inner: $nested, )+)?
        }

        #[allow(unused_imports, reason = "not every section has every kind of default and limit")]
        #[allow(clippy::wrong_self_convention, reason = "methods are named as the keys are, from_e_per_s among them")]
        impl $keys {
            $(
                $(#[doc = $sentence])+
                pub(super) fn $key(&self) -> $crate::key::Given<'_, $type> {
                    use $crate::{check::Rule::*, declared::Preset::*};
                    $crate::key::Given {
                        table: $crate::key::Section::table(self),
                        name: $crate::declared::plain(stringify!($key)),
                        raw: self.$key.as_ref(),
                        preset: ($preset).into(),
                        limit: ($limit).into(),
                        advice: $crate::key::advice(concat!($($sentence),+), &[$($advice)?]),
                    }
                }
            )*
        }

        #[allow(unused_imports, reason = "not every section has every kind of default and limit")]
        impl $crate::key::Section for $keys {
            fn declared() -> $crate::declared::Declared {
                use $crate::{check::Rule::*, declared::Preset::*};
                $crate::declared::Declared {
                    keys: vec![$( $crate::declared::Key::of::<$type>(
                        [stringify!($key), concat!($($sentence),+)],
                        &[$($advice)?],
                        ($preset).into(),
                        &($limit).into(),
                    ), )*],
                    tables: vec![$($( $crate::declared::Table {
                        name: stringify!($inner),
                        sentence: concat!($($what),+).trim_ascii(),
                        presence: <$nested as $crate::key::Inner>::PRESENCE,
                        forms: <$nested as $crate::key::Inner>::forms(),
                    }, )+)?],
                }
            }

            fn table(&self) -> &str {
                self.placed_at.as_deref().unwrap_or($place)
            }

            #[allow(clippy::needless_update, reason = "a section may have no key but its place")]
            fn at(&self, table: &str) -> Self {
                Self { placed_at: Some(table.into()), ..self.clone() }
            }

            fn given(&self) -> Vec<(&'static str, bool)> {
                vec![$( ($crate::declared::plain(stringify!($key)), self.$key.is_some()), )*]
            }
        }
    )+ };
}

pub(super) use section;
pub(super) use taken;
