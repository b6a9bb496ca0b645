//! A row of the words of `[[event]]`: its timing, its keys, and the action that they make.
//!
//! ```text
//! "bus_delay" Lasts (delay_ms) [jitter_ms] => Bus(LinkFault::Delay { by: delay_ms, jitter: jitter_ms });
//! ```
//!
//! the word, its [`Timing`], the keys that it needs, those that may be left out, and the variant of [`Action`](crate::event::Action).
//! The variant is an expression when a file is read and a pattern when an event is named or written, so that one row does
//! all three, and an action without a row does not compile. A key may have bounds of its own (`share.advised(..)`).
//! Several keys may make one value: `pixels(4096) of (px, count)` is read by `Reader::pixels`. How values are written:
//! `event_writer`.

use crate::{error::ConfigError, event::Action, event_reader::Reader, event_word::ACTIONS};

/// When an event happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Timing {
    /// At an instant.
    Once,
    /// From an instant for a time.
    Lasts,
    /// The same, or after a trigger.
    Waits,
}

/// Everything about a word except its name.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) timing: Timing,
    /// Keys by the value that they make.
    pub(super) needed: &'static [&'static [&'static str]],
    pub(super) optional: &'static [&'static [&'static str]],
    pub(super) read: fn(&mut Reader<'_, '_>) -> Result<Action, ConfigError>,
}

impl Row {
    /// Returns the keys that go with it beside those of all: those it needs, and those that may be left out.
    pub(super) fn keys(&self) -> [Vec<&'static str>; 2] {
        let length = self.lasts().then_some("for_s");
        [length.into_iter().chain(self.needed.concat()).collect(), self.optional.concat()]
    }

    pub(super) fn has_key(&self, name: &str) -> bool {
        self.keys().concat().contains(&name)
    }

    pub(super) fn lasts(&self) -> bool {
        self.timing != Timing::Once
    }
}

/// Returns the words whose row is wanted, each in quotes.
pub(super) fn words(is_wanted: impl Fn(&Row) -> bool) -> String {
    let wanted = ACTIONS.iter().filter(|(_, row)| is_wanted(row));
    wanted.map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ")
}

/// The words: see the top of this file.
macro_rules! rows {
    ($(
        $word:literal $timing:ident
        ($(
            $needed:ident
            $(($($need:expr),*) of ($($needed_key:ident),+))?
            $(. $need_method:ident ($($need_bound:expr),*))*
        ),*)
        [$(
            $optional:ident
            $(($($option:expr),*) of ($($optional_key:ident),+))?
            $(. $option_method:ident ($($option_bound:expr),*))*
        ),*]
        => $variant:ident $value:tt;
    )+) => {
        /// Every word for `do` with its row.
        pub(super) const ACTIONS: &[(&str, Row)] = &[$((
            $word,
            Row {
                timing: $crate::event_row::Timing::$timing,
                needed: &[$($crate::event_row::keys_of!($needed $(($($needed_key),+))?)),*],
                optional: &[$($crate::event_row::keys_of!($optional $(($($optional_key),+))?)),*],
                read: |reader| {
                    let _ = &reader;
                    $( let $needed = $crate::event_row::read!(
                        reader, $needed $(($($need),*))? $(. $need_method ($($need_bound),*))*
                    ); )*
                    $( let $optional = $crate::event_row::read!(
                        reader, $optional $(($($option),*))? $(. $option_method ($($option_bound),*))*
                    ); )*
                    Ok(Action::$variant $value)
                },
            },
        )),+];

        impl Action {
            /// Returns its word for `do` in `[[event]]`, which events and reports name it by.
            #[allow(unused_variables, reason = "a row's pattern binds what `keys` writes")]
            pub fn word(&self) -> &'static str {
                match *self {
                    $( Self::$variant $value => $word, )+
                }
            }

            /// Returns the keys that make it again, with their values.
            pub(super) fn keys(&self) -> $crate::event_writer::Keys {
                use $crate::event_writer::Written;
                let mut keys = Vec::new();
                match *self {
                    $( Self::$variant $value => {
                        $( $needed.write(stringify!($needed), &mut keys); )*
                        $( $optional.write(stringify!($optional), &mut keys); )*
                    } )+
                }
                keys
            }
        }
    };
}

/// The names of the keys of one value.
macro_rules! keys_of {
    ($key:ident) => { &[stringify!($key)] };
    ($value:ident ($($key:ident),+)) => { &[$(stringify!($key)),+] };
}

/// The value of one key, or of several.
macro_rules! read {
    ($reader:ident, $key:ident $(. $method:ident ($($bound:expr),*))*) => {
        $crate::event_reader::Taken::taken($reader.keys.$key() $(. $method($($bound),*))*, $reader.check)?
    };
    ($reader:ident, $value:ident ($($bound:expr),*)) => { $reader.$value($($bound),*)? };
}

pub(super) use keys_of;
pub(super) use read;
pub(super) use rows;
