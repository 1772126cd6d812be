//! Tables of numbers from outside: what is written comes back, and the reader agrees with a slow, obvious twin.

use granular_id::number_table::{parse, write, Column};
use proptest::prelude::*;

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn check(text: &[u8], n_columns: usize) {
    match (parse(text, n_columns), crate::twins::number_table::read(text, n_columns)) {
        (Ok(values), Ok(expected)) => assert_eq!(bits(&values), bits(&expected)),
        (got, expected) => assert_eq!(got, expected, "{:?}", text.escape_ascii().to_string()),
    }
}

fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        any::<u64>()
            .prop_map(f64::from_bits)
            .prop_filter("finite", |v| v.is_finite())
            .prop_map(|v| format!("{v:?}")),
        (-4000..4000_i32, 0..9_u32)
            .prop_map(|(v, e)| format!("{}", f64::from(v) / 10_f64.powi(e.cast_signed()))),
        "[ \t]?[+-]?[0-9]{0,22}[.]?[0-9]{0,22}([eE][+-]?[0-9]{1,3})?[ \t]?",
        "[0-9+.eE \t-]{0,8}",
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn tables_of_plain_numbers(
        rows in prop::collection::vec(prop::collection::vec(number(), 3), 1..6),
        line_end in prop_oneof![Just("\n"), Just("\r\n")],
        last in prop_oneof![Just(""), Just("\n"), Just("\r\n\r\n")],
    ) {
        let lines: Vec<_> = rows.iter().map(|row| row.join(",")).collect();
        check((lines.join(line_end) + last).as_bytes(), 3);
    }

    #[test]
    fn bytes_that_tables_are_made_of(
        text in "[0-9.,eE+\n\r \t\0x-]{0,40}",
        n_columns in 0..4_usize,
    ) {
        check(text.as_bytes(), n_columns);
    }

    #[test]
    fn any_bytes(text in prop::collection::vec(any::<u8>(), 0..80), n_columns in 0..4_usize) {
        check(&text, n_columns);
    }

    #[test]
    fn what_is_written_comes_back(
        numbers in prop::collection::vec(any::<u64>().prop_map(f64::from_bits), 1..50),
        whole in any::<u8>(),
    ) {
        let numbers: Vec<_> = numbers.into_iter().filter(|value| value.is_finite()).collect();
        prop_assume!(!numbers.is_empty());
        let flags = vec![whole; numbers.len()];
        let text = write(&[Column::Numbers(&numbers), Column::Whole(&flags)]).unwrap();
        let values = parse(text.as_bytes(), 2).unwrap();
        let expected: Vec<_> = numbers.iter().flat_map(|number| [*number, f64::from(whole)]).collect();
        assert_eq!(bits(&values), bits(&expected));
    }
}

#[test]
fn halves_are_rounded_to_even() {
    for text in [
        "9007199254740993",
        "9007199254740993.0000000000000000000000001",
        "1.00000000000000011102230246251565404236316680908203125",
        "1.00000000000000011102230246251565404236316680908203124",
        "2.4703282292062327208e-324",
        "2.4703282292062328e-324",
        "0.000000000000000000000000000000000001",
        "179769313486231580793728971405303415079934132710037826936173778980444968292764750946649017977587207096330286416692887910946555547851940402630657488671505820681908902000708383676273854845817711531764475730270069855571366959622842914819860834936475292719074168444365510704342711559699508093042880",
    ] {
        check(text.as_bytes(), 1);
    }
}
