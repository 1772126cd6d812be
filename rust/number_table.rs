//! Tables of numbers as CSV text: a strict reader and a writer that loses no bit.
//!
//! A row is a line of numbers separated by commas, each row with as many as there are columns. A number is a plain
//! decimal (`-1.5e-3`, `+6`, `.5`, `5.`), with or without blanks and tabs around it, and finite as float64. Lines end
//! with LF or CR LF; the last one may lack it. Empty lines and blanks may follow the last row, and nowhere else.
//!
//! Whatever else parsers let pass is refused, as each hides a mistake: `nan`, `inf`, `1e999`, `1_000`, `0x10`, `"1"`,
//! `1d3`, comments, rows of another length, NUL bytes.

use lexical_parse_float::FromLexical;

use crate::error::{shown, Error};
use crate::memory::reserved;

/// Longest line without its end: seven numbers of 25 characters need 181 bytes.
pub const MAX_LINE_BYTES: usize = 4096;

/// Reads the numbers of a text, row by row: `n_columns` to a row.
///
/// Each is the float64 nearest to what is written (ties to even). Memory stays below five times that of the text.
///
/// ```
/// use granular_id::number_table::{parse, ParseError, ParseErrorKind};
///
/// assert_eq!(parse(b"1, -2.5\r\n.5e1,0\n\n", 2), Ok(vec![1.0, -2.5, 5.0, 0.0]));
/// let kind = ParseErrorKind::NotANumber { cell: b"nan".to_vec() };
/// assert_eq!(parse(b"1,2\n3,nan\n", 2), Err(ParseError { row: 1, column: Some(1), kind }));
/// ```
pub fn parse(text: &[u8], n_columns: usize) -> Result<Vec<f64>, ParseError> {
    let end = text
        .iter()
        .rposition(|byte| !matches!(byte, b'\r' | b'\n' | b' ' | b'\t'))
        .map_or(0, |last| last + 1);
    let text = &text[..end];
    if text.is_empty() {
        return Err(ParseError { row: 0, column: None, kind: ParseErrorKind::NoRows });
    }
    let rows = 1 + text.iter().map(|byte| usize::from(*byte == b'\n')).sum::<usize>();
    // A cell and its separator are two bytes: a text of bare line ends asks for no more than it could hold.
    let cells = rows.saturating_mul(n_columns).min(text.len() / 2 + 1);
    let mut values = reserved(cells).map_err(|error| ParseError {
        row: 0,
        column: None,
        kind: ParseErrorKind::Memory(error),
    })?;
    let mut at = 0;
    for row in 0..rows {
        at = parse_row(text, at, n_columns, &mut values)
            .map_err(|(column, problem)| row_error(&text[at..], row, column, problem, n_columns))?;
    }
    Ok(values)
}

/// Where and why a text is no table of numbers.
///
/// Not a variant of [`Error`], which is about arguments: a file has places.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("row {row}{}: {kind}", .column.map(|column| format!(", column {column}")).unwrap_or_default())]
pub struct ParseError {
    /// The row, from 0; as all rows before it were read, also the number of line ends before it.
    pub row: usize,
    /// The column, from 0; `None` where the row as a whole is wrong.
    pub column: Option<usize>,
    /// What is wrong.
    pub kind: ParseErrorKind,
}

/// What is wrong with a row or a cell.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseErrorKind {
    /// The text has no row at all.
    #[error("has a header but no samples")]
    NoRows,
    /// A line of more than [`MAX_LINE_BYTES`] bytes.
    #[error("the line is longer than {MAX_LINE_BYTES} bytes")]
    LongLine,
    /// A NUL byte in the line.
    #[error("is binary (holds NUL bytes); wanted text")]
    Binary,
    /// An empty line before the last row.
    #[error("the line is empty; only the end of a file may be")]
    EmptyLine,
    /// Another number of cells than there are columns; the cells that have a column are numbers.
    #[error("{got} {}; wanted {wanted}, as in the header", if *.got == 1 { "cell" } else { "cells" })]
    Cells {
        /// Cells of the row.
        got: usize,
        /// Columns of the table.
        wanted: usize,
    },
    /// A cell that is empty or blank.
    #[error("the cell is empty; wanted a number")]
    EmptyCell,
    /// A cell that is no plain decimal number.
    #[error("{} is not a plain decimal number{}", shown(.cell), remark(.cell))]
    NotANumber {
        /// The cell without the blanks around it.
        cell: Vec<u8>,
    },
    /// A number that float64 cannot hold.
    #[error("{} is too large for float64", shown(.cell))]
    TooLarge {
        /// The cell without the blanks around it.
        cell: Vec<u8>,
    },
    /// No memory for the numbers of the whole table.
    #[error(transparent)]
    Memory(Error),
}

/// Which character it is that looks like part of a number and is none: a typographic minus, say.
fn remark(cell: &[u8]) -> String {
    let text = str::from_utf8(cell).unwrap_or_default();
    text.chars()
        .find(|character| !character.is_ascii())
        .map_or_else(String::new, |character| format!("; it holds U+{:04X}", u32::from(character)))
}

/// What stops the reading of a row, before anybody looks for the reason.
#[derive(Clone, Copy)]
enum Problem {
    /// The cell is no number.
    Cell,
    /// The number is too large.
    Large,
    /// The line is too long, or has another number of cells.
    Row,
}

/// Reads the row that begins at `at`; returns where the next one does.
fn parse_row(
    text: &[u8],
    mut at: usize,
    n_columns: usize,
    values: &mut Vec<f64>,
) -> Result<usize, (usize, Problem)> {
    let start = at;
    let mut column = 0;
    loop {
        // Of a row with too many cells, those without a column are not looked at.
        if column == n_columns {
            return Err((column, Problem::Row));
        }
        let (value, next) = number(text, at).ok_or((column, Problem::Cell))?;
        let line_end = match text.get(next) {
            Some(b',') => None,
            Some(b'\n') => Some(next + 1),
            Some(b'\r') if text.get(next + 1) == Some(&b'\n') => Some(next + 2),
            Some(_) => return Err((column, Problem::Cell)),
            None => Some(next),
        };
        if !value.is_finite() {
            return Err((column, Problem::Large));
        }
        values.push(value);
        column += 1;
        match line_end {
            None => at = next + 1,
            Some(_) if next - start > MAX_LINE_BYTES => return Err((column, Problem::Row)),
            Some(_) if column < n_columns => return Err((column, Problem::Row)),
            Some(line_end) => return Ok(line_end),
        }
    }
}

/// The error of a row: what is wrong with its line comes before what is wrong with a cell.
fn row_error(rest: &[u8], row: usize, column: usize, problem: Problem, n_columns: usize) -> ParseError {
    let line = rest.split(|byte| *byte == b'\n').next().unwrap_or_default();
    // The last line of a text lost its end together with the blanks after it.
    let line = if line.len() < rest.len() { line.strip_suffix(b"\r").unwrap_or(line) } else { line };
    let whole = |kind| ParseError { row, column: None, kind };
    if line.len() > MAX_LINE_BYTES {
        return whole(ParseErrorKind::LongLine);
    }
    if line.contains(&0) {
        return whole(ParseErrorKind::Binary);
    }
    if line.is_empty() {
        return whole(ParseErrorKind::EmptyLine);
    }
    let cell = line.split(|byte| *byte == b',').nth(column).unwrap_or_default().trim_ascii().to_vec();
    let kind = match problem {
        Problem::Row => {
            let got = line.split(|byte| *byte == b',').count();
            return whole(ParseErrorKind::Cells { got, wanted: n_columns });
        }
        Problem::Large => ParseErrorKind::TooLarge { cell },
        Problem::Cell if cell.is_empty() => ParseErrorKind::EmptyCell,
        Problem::Cell => ParseErrorKind::NotANumber { cell },
    };
    ParseError { row, column: Some(column), kind }
}

/// Powers of ten that float64 holds exactly.
const EXACT: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18,
    1e19, 1e20, 1e21, 1e22,
];

/// The largest whole number up to which float64 holds every one.
const WHOLE: u64 = 1 << 53;

/// Digits that u64 holds, whatever they are.
const DIGITS: usize = 19;

/// The number that begins at `at`, with the blanks around it, and where it ends; infinite where it is too large.
fn number(text: &[u8], at: usize) -> Option<(f64, usize)> {
    let begin = blanks(text, at);
    let whole = begin + usize::from(matches!(text.get(begin), Some(b'-' | b'+')));
    let mut mantissa = 0;
    let mut end = digits(text, whole, &mut mantissa);
    let mut n_digits = end - whole;
    let mut places = 0;
    if text.get(end) == Some(&b'.') {
        let fraction = end + 1;
        end = digits(text, fraction, &mut mantissa);
        places = end - fraction;
        n_digits += places;
    }
    if n_digits == 0 {
        return None;
    }
    let exponent = text.get(end).is_some_and(|byte| matches!(byte, b'e' | b'E'));
    if exponent {
        let power = end + 1 + usize::from(matches!(text.get(end + 1), Some(b'-' | b'+')));
        end = digits(text, power, &mut 0);
        if end == power {
            return None;
        }
    }
    let value = if !exponent && n_digits <= DIGITS && mantissa <= WHOLE {
        // Both operands are exact, so the quotient is rounded once: the nearest float64 (Clinger 1990).
        let value = mantissa as f64 / EXACT[places];
        if text[begin] == b'-' {
            -value
        } else {
            value
        }
    } else {
        // Not `str::parse`: it takes 20 times as long for numbers half-way between two very small or large ones.
        f64::from_lexical(&text[begin..end]).ok()?
    };
    Some((value, blanks(text, end)))
}

/// The place after the blanks that begin at `at`.
fn blanks(text: &[u8], mut at: usize) -> usize {
    while let Some(b' ' | b'\t') = text.get(at) {
        at += 1;
    }
    at
}

/// The place after the digits that begin at `at`; appends them to `value`, which wraps around.
fn digits(text: &[u8], mut at: usize, value: &mut u64) -> usize {
    while let Some(byte @ b'0'..=b'9') = text.get(at) {
        *value = value.wrapping_mul(10).wrapping_add(u64::from(byte - b'0'));
        at += 1;
    }
    at
}

/// Bytes to make room for per cell: a float64 of any history needs 17 digits.
const TYPICAL: usize = 20;

/// Bytes of the longest cell and what follows it.
const LONGEST: usize = 25;

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Column<'a> {
    /// Measured values: finite.
    Numbers(&'a [f64]),
    /// Bits or counts, written without a point.
    Whole(&'a [u8]),
}

impl Column<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Whole(values) => values.len(),
        }
    }
}

/// Writes columns of equal length as lines of text; [`parse`] gives back every bit of them.
///
/// Each number has the fewest digits that no other float64 shares; lines end with LF.
///
/// ```
/// use granular_id::number_table::{write, Column};
///
/// let columns = [Column::Numbers(&[0.1, -0.0]), Column::Numbers(&[1e300, 2.0]), Column::Whole(&[0, 4])];
/// assert_eq!(write(&columns)?, "0.1,1e+300,0\n-0.0,2.0,4\n");
/// # Ok::<(), granular_id::Error>(())
/// ```
pub fn write(columns: &[Column<'_>]) -> Result<String, Error> {
    let rows = columns.first().map_or(0, Column::len);
    for column in columns {
        if column.len() != rows {
            return Err(Error::Length { what: "each column", expected: rows, got: column.len() });
        }
    }
    let mut text = String::new();
    reserve(&mut text, rows.saturating_mul(columns.len()).saturating_mul(TYPICAL))?;
    let mut digits = zmij::Buffer::new();
    for row in 0..rows {
        reserve(&mut text, columns.len() * LONGEST)?;
        for (index, column) in columns.iter().enumerate() {
            if index > 0 {
                text.push(',');
            }
            match column {
                Column::Numbers(values) if values[row].is_finite() => {
                    text += digits.format_finite(values[row]);
                }
                Column::Numbers(values) => {
                    return Err(Error::NonFiniteCell { column: index, row, value: values[row] })
                }
                Column::Whole(values) => text += &values[row].to_string(),
            }
        }
        text.push('\n');
    }
    Ok(text)
}

/// Makes room for more text.
fn reserve(text: &mut String, bytes: usize) -> Result<(), Error> {
    text.try_reserve(bytes).map_err(|_| Error::Memory { bytes })
}

#[cfg(test)]
mod tests {
    use super::ParseErrorKind as Kind;
    use super::*;

    fn kind(text: &str, n_columns: usize) -> (usize, Option<usize>, Kind) {
        let error = parse(text.as_bytes(), n_columns).unwrap_err();
        (error.row, error.column, error.kind)
    }

    #[test]
    fn plain_decimals() {
        for (text, value) in [
            ("0", 0.0),
            ("-0", -0.0),
            ("-0.0", -0.0),
            ("+6", 6.0),
            ("5.", 5.0),
            (".5", 0.5),
            (" \t1\t ", 1.0),
            ("007", 7.0),
            ("1e3", 1e3),
            ("1E+3", 1e3),
            ("-2.5e-3", -2.5e-3),
            ("0.1", 0.1),
            ("9007199254740992", 9_007_199_254_740_992.0),
            ("9007199254740993", 9_007_199_254_740_992.0),
            ("0.3000000000000000444", 0.300_000_000_000_000_04),
            ("99999999999999999999", 1e20),
            ("4.9e-324", 5e-324),
            ("1e-999999999999999999999", 0.0),
            ("1.7976931348623157e308", f64::MAX),
            ("0e999999999999999999999", 0.0),
        ] {
            let values = parse(text.as_bytes(), 1).unwrap();
            assert_eq!(values.len(), 1, "{text}");
            assert_eq!(values[0].to_bits(), value.to_bits(), "{text}");
        }
    }

    #[test]
    fn everything_else_is_no_number() {
        for text in [
            "nan",
            "inf",
            "-inf",
            "infinity",
            "1_000",
            "0x10",
            "1d3",
            "1e",
            "1e+",
            "e5",
            ".",
            "-",
            "+",
            "-.",
            ".e1",
            "--1",
            "1-",
            "1 2",
            "1.2.3",
            "1e1.5",
            "\"1\"",
            "1;",
            "# 1",
            "1\r1",
            "\u{661}",
            "\u{2212}1",
            "1\u{a0}",
        ] {
            let cell = text.as_bytes().to_vec();
            assert_eq!(kind(text, 1), (0, Some(0), Kind::NotANumber { cell }), "{text}");
        }
        for text in ["1e999", "-1e309", &"9".repeat(400)] {
            let cell = text.as_bytes().to_vec();
            assert_eq!(kind(text, 1), (0, Some(0), Kind::TooLarge { cell }), "{text}");
        }
    }

    #[test]
    fn lines() {
        assert_eq!(parse(b"1,2\n3,4", 2).unwrap(), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(parse(b"1,2\r\n3,4 \r\n\r\n \n", 2).unwrap(), [1.0, 2.0, 3.0, 4.0]);
        for blank in ["", "\n", "\r\n \t\n"] {
            assert_eq!(kind(blank, 2), (0, None, Kind::NoRows));
        }
        assert_eq!(kind("1,2\n\n3,4", 2), (1, None, Kind::EmptyLine));
        assert_eq!(kind("1,2\n\r\n3,4", 2), (1, None, Kind::EmptyLine));
        assert_eq!(kind("1,2\n  \n3,4", 2), (1, Some(0), Kind::EmptyCell));
        assert_eq!(kind("1,2\n3,\n", 2), (1, Some(1), Kind::EmptyCell));
        assert_eq!(kind("1,2\n3", 2), (1, None, Kind::Cells { got: 1, wanted: 2 }));
        assert_eq!(kind("1,2\n3,4,x\n", 2), (1, None, Kind::Cells { got: 3, wanted: 2 }));
        assert_eq!(kind("1,2\nx,4,5\n", 2), (1, Some(0), Kind::NotANumber { cell: b"x".to_vec() }));
        assert_eq!(kind("1,2", 0), (0, None, Kind::Cells { got: 2, wanted: 0 }));
        assert_eq!(kind("1,2\n3,4\r\r\n5,6", 2), (1, Some(1), Kind::NotANumber { cell: b"4".to_vec() }));
    }

    #[test]
    fn what_is_wrong_with_a_line_comes_first() {
        assert_eq!(kind("x\0,2,3\n", 2), (0, None, Kind::Binary));
        let longest = format!("{},2", "1".repeat(MAX_LINE_BYTES - 2));
        assert_eq!(kind(&longest, 2), (0, Some(0), Kind::TooLarge { cell: vec![b'1'; MAX_LINE_BYTES - 2] }));
        assert_eq!(kind(&format!("1{longest}"), 2), (0, None, Kind::LongLine));
        let blank = " ".repeat(MAX_LINE_BYTES - 3);
        assert_eq!(parse(format!("1,2{blank}\r\n3,4").as_bytes(), 2).unwrap().len(), 4);
        assert_eq!(kind(&format!("1,2{blank} \n3,4"), 2), (0, None, Kind::LongLine));
        assert_eq!(kind(&format!("x\0{}", "x".repeat(MAX_LINE_BYTES)), 2), (0, None, Kind::LongLine));
    }

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
    fn the_place_is_named() {
        let error = ParseError { row: 3, column: None, kind: Kind::Cells { got: 1, wanted: 7 } };
        assert_eq!(error.to_string(), "row 3: 1 cell; wanted 7, as in the header");
        let error = ParseError { row: 0, column: Some(2), kind: Kind::EmptyCell };
        assert_eq!(error.to_string(), "row 0, column 2: the cell is empty; wanted a number");
    }

    #[test]
    fn the_fewest_digits() {
        let values = [0.1, -0.3, 1.0, 0.1 + 0.2, 5e-324, f64::MAX, 1e16, 123_456.789, 1e-5, -0.0];
        let text = "0.1\n-0.3\n1.0\n0.30000000000000004\n5e-324\n1.7976931348623157e+308\n1e+16\n123456.789\n0.00001\n-0.0\n";
        assert_eq!(write(&[Column::Numbers(&values)]).unwrap(), text);
    }

    #[test]
    fn columns_that_cannot_be_read_back_are_refused() {
        for value in [f64::NAN, f64::INFINITY] {
            let error = write(&[Column::Whole(&[1, 2]), Column::Numbers(&[0.0, value])]).unwrap_err();
            assert!(matches!(error, Error::NonFiniteCell { column: 1, row: 1, .. }));
        }
        let error = write(&[Column::Whole(&[1]), Column::Numbers(&[0.0, 1.0])]);
        assert_eq!(error, Err(Error::Length { what: "each column", expected: 1, got: 2 }));
    }

    #[test]
    fn nothing_to_write() {
        assert_eq!(write(&[]).unwrap(), "");
        assert_eq!(write(&[Column::Numbers(&[])]).unwrap(), "");
    }
}
