//! A reader of number tables written for its obviousness, against which the fast one is tested and fuzzed.

use granular_id::number_table::{ParseError, ParseErrorKind, MAX_LINE_BYTES};

/// What `parse` promises, written out with `split`, a check of the grammar and `str::parse`.
pub fn read(text: &[u8], n_columns: usize) -> Result<Vec<f64>, ParseError> {
    let blank = |byte: &u8| b" \t\r\n".contains(byte);
    let end = text.len() - text.iter().rev().take_while(|byte| blank(byte)).count();
    if end == 0 {
        return Err(ParseError { row: 0, column: None, kind: ParseErrorKind::NoRows });
    }
    let lines: Vec<_> = text[..end].split(|byte| *byte == b'\n').collect();
    let mut values = Vec::new();
    for (row, line) in lines.iter().enumerate() {
        let line = if row + 1 < lines.len() { line.strip_suffix(b"\r").unwrap_or(line) } else { line };
        let whole = |kind| Err(ParseError { row, column: None, kind });
        if line.len() > MAX_LINE_BYTES {
            return whole(ParseErrorKind::LongLine);
        }
        if line.contains(&0) {
            return whole(ParseErrorKind::Binary);
        }
        if line.is_empty() {
            return whole(ParseErrorKind::EmptyLine);
        }
        let cells: Vec<_> = line.split(|byte| *byte == b',').collect();
        for (column, cell) in cells.iter().take(n_columns).enumerate() {
            let trimmed = cell.trim_ascii().to_vec();
            let kind = match plain(cell) {
                Some(value) if value.is_finite() => {
                    values.push(value);
                    continue;
                }
                Some(_) => ParseErrorKind::TooLarge { cell: trimmed },
                None if trimmed.is_empty() => ParseErrorKind::EmptyCell,
                None => ParseErrorKind::NotANumber { cell: trimmed },
            };
            return Err(ParseError { row, column: Some(column), kind });
        }
        if cells.len() != n_columns {
            return whole(ParseErrorKind::Cells { got: cells.len(), wanted: n_columns });
        }
    }
    Ok(values)
}

fn plain(cell: &[u8]) -> Option<f64> {
    let text = str::from_utf8(cell).ok()?.trim_matches([' ', '\t']);
    let unsigned = text.strip_prefix(['+', '-']).unwrap_or(text);
    let (mantissa, exponent) = match unsigned.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, Some(exponent.strip_prefix(['+', '-']).unwrap_or(exponent))),
        None => (unsigned, None),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let good = digits(whole) && digits(fraction) && whole.len() + fraction.len() > 0;
    let good = good && exponent.is_none_or(|exponent| digits(exponent) && !exponent.is_empty());
    good.then(|| text.parse().expect("Rust reads every plain decimal"))
}
