//! Tables of numbers as CSV text: a strict reader and a writer that loses no bit.
//!
//! A row is a line of numbers separated by commas, each row with as many as there are columns. A number is a plain
//! decimal (`-1.5e-3`, `+6`, `.5`, `5.`), with or without blanks and tabs around it, and finite as float64. Lines end
//! with LF or CR LF; the last one may lack it. Empty lines and blanks may follow the last row, and nowhere else.
//!
//! Whatever else parsers let pass is refused, as each hides a mistake: `nan`, `inf`, `1e999`, `1_000`, `0x10`, `"1"`,
//! `1d3`, comments, rows of another length, NUL bytes.

mod fault;
mod parse;
mod write;

pub(crate) use fault::shown;
pub use fault::{Fault, Kind};
pub use parse::{parse, MAX_LINE_BYTES};
pub use write::{write, Column};
