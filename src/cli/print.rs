//! `print!` and its relatives for commands: the same as those of the standard library, but a standard stream that is
//! full or closed is an error and not a panic ([`streams`](base::streams)).
//!
//! `print!` and `println!` end the program when standard output cannot be written; `eprint!` and `eprintln!` never do.

macro_rules! print {
    ($($text:tt)*) => { base::streams::print(format_args!($($text)*)) };
}

macro_rules! println {
    ($($text:tt)*) => { base::streams::print(format_args!("{}\n", format_args!($($text)*))) };
}

macro_rules! eprint {
    ($($text:tt)*) => { base::streams::say(format_args!($($text)*)) };
}

macro_rules! eprintln {
    () => { base::streams::say(format_args!("\n")) };
    ($($text:tt)*) => { base::streams::say(format_args!("{}\n", format_args!($($text)*))) };
}
