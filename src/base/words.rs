//! Enums whose variants have a word each: in files, messages, tables.

/// Makes an enum of `Variant = "word"` with a list of all of them and their words.
#[macro_export]
macro_rules! words {
    ($(#[$on:meta])* $visibility:vis enum $name:ident { $($(#[$about:meta])* $variant:ident = $word:literal,)+ }) => {
        $(#[$on])*
        $visibility enum $name { $($(#[$about])* $variant,)+ }

        #[allow(dead_code, reason = "not every list is asked for")]
        impl $name {
            /// Every one, in order.
            pub const ALL: [Self; [$($word),+].len()] = [$(Self::$variant),+];

            /// Every one with its word.
            pub const NAMED: [(&'static str, Self); [$($word),+].len()] = [$(($word, Self::$variant)),+];

            /// Returns its word.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $word,)+ }
            }
        }
    };
}
