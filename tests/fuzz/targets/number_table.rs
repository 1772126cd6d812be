//! The reader of number tables against its slow twin: the same bits or the same fault; what it reads, it writes.

#![no_main]

#[path = "../../core/twins/number_table.rs"]
mod twin;

use granular_id::number_table::{parse, write, Column};
use libfuzzer_sys::fuzz_target;

/// The longest message: a cell of 40 characters, each escaped, and the words around it.
const LONGEST_MESSAGE: usize = 600;

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

// The first byte is the number of columns, the rest the text.
fuzz_target!(|data: &[u8]| {
    let Some((&first, text)) = data.split_first() else { return };
    let n_columns = usize::from(first % 9);
    match (parse(text, n_columns), twin::read(text, n_columns)) {
        (Ok(values), Ok(expected)) => {
            assert_eq!(bits(&values), bits(&expected));
            let columns: Vec<Vec<f64>> =
                (0..n_columns).map(|i| values.iter().copied().skip(i).step_by(n_columns).collect()).collect();
            let columns: Vec<_> = columns.iter().map(|column| Column::Numbers(column)).collect();
            let written = write(&columns).expect("what was read is finite");
            assert_eq!(bits(&parse(written.as_bytes(), n_columns).expect("what was written")), bits(&values));
        }
        (got, expected) => {
            assert_eq!(got, expected);
            assert!(got.unwrap_err().to_string().len() < LONGEST_MESSAGE);
        }
    }
});
