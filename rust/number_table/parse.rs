//! Text to numbers, in one pass.

use lexical_parse_float::FromLexical;

use super::fault::{Fault, Kind};
use crate::memory::reserved;

/// Longest line without its end: seven numbers of 25 characters need 181 bytes.
pub const MAX_LINE_BYTES: usize = 4096;

/// Reads the numbers of a text, row by row: `n_columns` to a row.
///
/// Each is the float64 nearest to what is written (ties to even). Memory stays below five times that of the text.
///
/// ```
/// use granular_id::number_table::{parse, Fault, Kind};
///
/// assert_eq!(parse(b"1, -2.5\r\n.5e1,0\n\n", 2), Ok(vec![1.0, -2.5, 5.0, 0.0]));
/// let kind = Kind::NotANumber { cell: b"nan".to_vec() };
/// assert_eq!(parse(b"1,2\n3,nan\n", 2), Err(Fault { row: 1, column: Some(1), kind }));
/// ```
pub fn parse(text: &[u8], n_columns: usize) -> Result<Vec<f64>, Fault> {
    let end = text
        .iter()
        .rposition(|byte| !matches!(byte, b'\r' | b'\n' | b' ' | b'\t'))
        .map_or(0, |last| last + 1);
    let text = &text[..end];
    if text.is_empty() {
        return Err(Fault { row: 0, column: None, kind: Kind::NoRows });
    }
    let rows = 1 + text.iter().map(|byte| usize::from(*byte == b'\n')).sum::<usize>();
    // A cell and its separator are two bytes: a text of bare line ends asks for no more than it could hold.
    let cells = rows.saturating_mul(n_columns).min(text.len() / 2 + 1);
    let mut values =
        reserved(cells).map_err(|error| Fault { row: 0, column: None, kind: Kind::Memory(error) })?;
    let mut at = 0;
    for row in 0..rows {
        at = parse_row(text, at, n_columns, &mut values)
            .map_err(|(column, problem)| fault(&text[at..], row, column, problem, n_columns))?;
    }
    Ok(values)
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

/// The fault of a row: what is wrong with its line comes before what is wrong with a cell.
fn fault(rest: &[u8], row: usize, column: usize, problem: Problem, n_columns: usize) -> Fault {
    let line = rest.split(|byte| *byte == b'\n').next().unwrap_or_default();
    // The last line of a text lost its end together with the blanks after it.
    let line = if line.len() < rest.len() { line.strip_suffix(b"\r").unwrap_or(line) } else { line };
    let whole = |kind| Fault { row, column: None, kind };
    if line.len() > MAX_LINE_BYTES {
        return whole(Kind::LongLine);
    }
    if line.contains(&0) {
        return whole(Kind::Binary);
    }
    if line.is_empty() {
        return whole(Kind::EmptyLine);
    }
    let cell = line.split(|byte| *byte == b',').nth(column).unwrap_or_default().trim_ascii().to_vec();
    let kind = match problem {
        Problem::Row => {
            let got = line.split(|byte| *byte == b',').count();
            return whole(Kind::Cells { got, wanted: n_columns });
        }
        Problem::Large => Kind::TooLarge { cell },
        Problem::Cell if cell.is_empty() => Kind::EmptyCell,
        Problem::Cell => Kind::NotANumber { cell },
    };
    Fault { row, column: Some(column), kind }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(text: &str, n_columns: usize) -> (usize, Option<usize>, Kind) {
        let fault = parse(text.as_bytes(), n_columns).unwrap_err();
        (fault.row, fault.column, fault.kind)
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
}
