//! `print!` and its relatives for commands: the same as those of the standard library, but a standard stream that is full
//! or closed is an error and not a panic ([`streams`](crate::base::streams)).
//!
//! `print!` and `println!` end the program when standard output cannot be written; `eprint!` and `eprintln!` never do.

macro_rules! print {
    ($($text:tt)*) => { $crate::base::streams::print(format_args!($($text)*)) };
}

macro_rules! println {
    ($($text:tt)*) => { $crate::base::streams::print(format_args!("{}\n", format_args!($($text)*))) };
}

macro_rules! eprint {
    ($($text:tt)*) => { $crate::base::streams::say(format_args!($($text)*)) };
}

macro_rules! eprintln {
    () => { $crate::base::streams::say(format_args!("\n")) };
    ($($text:tt)*) => { $crate::base::streams::say(format_args!("{}\n", format_args!($($text)*))) };
}
