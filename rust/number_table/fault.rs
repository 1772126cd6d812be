//! The first fault of a text that is no table of numbers: where it is and what is wrong there.

use std::fmt;

use crate::error::Error;

/// Characters of a cell that a message shows.
const SHOWN: usize = 40;

/// Where and why a text is no table of numbers.
///
/// Not a variant of [`Error`](crate::Error), which is about arguments: a file has places.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("row {row}{}: {kind}", .column.map(|column| format!(", column {column}")).unwrap_or_default())]
pub struct Fault {
    /// The row, from 0; as all rows before it were read, also the number of line ends before it.
    pub row: usize,
    /// The column, from 0; `None` where the row as a whole is at fault.
    pub column: Option<usize>,
    /// What is wrong.
    pub kind: Kind,
}

/// What is wrong with a row or a cell.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Kind {
    /// The text has no row at all.
    NoRows,
    /// A line of more than [`MAX_LINE_BYTES`](super::MAX_LINE_BYTES) bytes.
    LongLine,
    /// A NUL byte in the line.
    Binary,
    /// An empty line before the last row.
    EmptyLine,
    /// Another number of cells than there are columns; the cells that have a column are numbers.
    Cells {
        /// Cells of the row.
        got: usize,
        /// Columns of the table.
        wanted: usize,
    },
    /// A cell that is empty or blank.
    EmptyCell,
    /// A cell that is no plain decimal number.
    NotANumber {
        /// The cell without the blanks around it.
        cell: Vec<u8>,
    },
    /// A number that float64 cannot hold.
    TooLarge {
        /// The cell without the blanks around it.
        cell: Vec<u8>,
    },
    /// No memory for the numbers of the whole table.
    Memory(Error),
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRows => write!(f, "has a header but no samples"),
            Self::LongLine => write!(f, "the line is longer than {} bytes", super::MAX_LINE_BYTES),
            Self::Binary => write!(f, "is binary (holds NUL bytes); wanted text"),
            Self::EmptyLine => write!(f, "the line is empty; only the end of a file may be"),
            Self::Cells { got, wanted } => {
                let cells = if *got == 1 { "cell" } else { "cells" };
                write!(f, "{got} {cells}; wanted {wanted}, as in the header")
            }
            Self::EmptyCell => write!(f, "the cell is empty; wanted a number"),
            Self::NotANumber { cell } => {
                write!(f, "{} is not a plain decimal number{}", shown(cell), remark(cell))
            }
            Self::TooLarge { cell } => write!(f, "{} is too large for float64", shown(cell)),
            Self::Memory(error) => error.fmt(f),
        }
    }
}

/// Text from a file in quotes: cut where it is long, control characters and bytes that are no text escaped.
pub(crate) fn shown(cell: &[u8]) -> String {
    let mut text = String::from("'");
    let mut left = SHOWN;
    for chunk in cell.utf8_chunks() {
        for character in chunk.valid().chars().take(left) {
            left -= 1;
            if character.is_ascii_graphic() || character == ' ' {
                text.push(character);
            } else {
                text.extend(character.escape_debug());
            }
        }
        for byte in chunk.invalid().iter().take(left) {
            left -= 1;
            text.extend(byte.escape_ascii().map(char::from));
        }
    }
    text += if left == 0 && characters(cell) > SHOWN { "'..." } else { "'" };
    text
}

fn characters(cell: &[u8]) -> usize {
    cell.utf8_chunks().map(|chunk| chunk.valid().chars().count() + chunk.invalid().len()).sum()
}

/// Which character it is that looks like part of a number and is none: a typographic minus, say.
fn remark(cell: &[u8]) -> String {
    let text = str::from_utf8(cell).unwrap_or_default();
    text.chars()
        .find(|character| !character.is_ascii())
        .map_or_else(String::new, |character| format!("; it holds U+{:04X}", u32::from(character)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(cell: &[u8]) -> String {
        Kind::NotANumber { cell: cell.to_vec() }.to_string()
    }

    #[test]
    fn cells_are_shown_as_they_can_be_printed() {
        assert_eq!(problem(b"abc"), "'abc' is not a plain decimal number");
        assert_eq!(problem(b"\"1\""), "'\"1\"' is not a plain decimal number");
        assert_eq!(problem(b"6\xb0\x1b[2J"), r"'6\xb0\u{1b}[2J' is not a plain decimal number");
        assert_eq!(
            problem("\u{2212}1".as_bytes()),
            "'\u{2212}1' is not a plain decimal number; it holds U+2212"
        );
        assert_eq!(
            problem("\u{202e}1".as_bytes()),
            r"'\u{202e}1' is not a plain decimal number; it holds U+202E"
        );
    }

    #[test]
    fn long_cells_are_cut() {
        let forty = [b'x'; 40];
        assert_eq!(shown(&forty), format!("'{}'", "x".repeat(40)));
        assert_eq!(shown(&[b'x'; 41]), format!("'{}'...", "x".repeat(40)));
        assert_eq!(shown(&[0xff; 41]), format!("'{}'...", "\\xff".repeat(40)));
        assert_eq!(shown("é".repeat(50).as_bytes()), format!("'{}'...", "é".repeat(40)));
    }

    #[test]
    fn the_place_is_named() {
        let fault = Fault { row: 3, column: None, kind: Kind::Cells { got: 1, wanted: 7 } };
        assert_eq!(fault.to_string(), "row 3: 1 cell; wanted 7, as in the header");
        let fault = Fault { row: 0, column: Some(2), kind: Kind::EmptyCell };
        assert_eq!(fault.to_string(), "row 0, column 2: the cell is empty; wanted a number");
    }
}
