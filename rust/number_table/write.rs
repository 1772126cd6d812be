//! Numbers to text, with as many digits as they need.

use crate::error::{Error, Result};

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

/// Writes columns of equal length as lines of text; [`parse`](super::parse) gives back every bit of them.
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
pub fn write(columns: &[Column<'_>]) -> Result<String> {
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
fn reserve(text: &mut String, bytes: usize) -> Result<()> {
    text.try_reserve(bytes).map_err(|_| Error::Memory { bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

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
