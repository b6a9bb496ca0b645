//! Enums whose variants are words in files, tables and commands.

/// Makes an enum of words: `ALL` lists its variants in order, and `name` returns the word of one.
#[macro_export]
macro_rules! words {
    ($(#[$about:meta])* $visibility:vis enum $words:ident { $($(#[$of_one:meta])* $one:ident = $word:literal,)* }) => {
        $(#[$about])*
        $visibility enum $words {
            $($(#[$of_one])* $one,)*
        }

        impl $words {
            /// All of them, in order.
            pub const ALL: [Self; [$($word),*].len()] = [$(Self::$one),*];

            /// Returns the word in files, tables and commands.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$one => $word,)*
                }
            }
        }
    };
}
