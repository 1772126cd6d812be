//! The filter from outside: golden outputs of scipy, and any split of a signal against the whole.

use granular_id::{butterworth, sosfilt, sosfilt_from, AlongAxis, Band, Error, Sos, SosState};
use proptest::prelude::*;

use crate::twins::signals::bits;

/// Written by `make_filter_golden.py`.
const GOLDEN: &str = include_str!("../data/filter_golden.txt");

struct Golden {
    name: &'static str,
    order: usize,
    band: Band,
    rate_hz: f64,
    rows: Vec<[f64; 6]>,
    arrays: Vec<Vec<f64>>,
}

impl Golden {
    /// One case: its title line and the lines of numbers below it.
    fn parse(block: &'static str) -> Self {
        let mut lines = block.lines();
        let title: Vec<_> = lines.next().unwrap().split(' ').collect();
        let number = |i: usize| title[i].parse::<f64>().unwrap();
        let band = match title[2] {
            "lowpass" => Band::Lowpass(number(3)),
            "highpass" => Band::Highpass(number(3)),
            "bandpass" => Band::Bandpass(number(3), number(4)),
            _ => Band::Bandstop(number(3), number(4)),
        };
        let word = |word: &str| f64::from_bits(u64::from_str_radix(word, 16).unwrap());
        let mut arrays: Vec<Vec<f64>> =
            lines.map(|line| line.split(' ').skip(1).map(word).collect()).collect();
        let rows = arrays.remove(0).as_chunks::<6>().0.to_vec();
        Self { name: title[0], order: title[1].parse().unwrap(), band, rate_hz: number(5), rows, arrays }
    }
}

fn golden() -> impl Iterator<Item = Golden> {
    GOLDEN.split("case ").skip(1).map(Golden::parse)
}

#[test]
fn designs_equal_the_golden_ones() {
    assert_eq!(golden().count(), 7);
    for case in golden() {
        let sos = butterworth(case.order, case.band, case.rate_hz).unwrap();
        assert_eq!(sos.sections().len(), case.rows.len(), "{}", case.name);
        for (section, wanted) in sos.sections().iter().zip(&case.rows) {
            for half in [0..3, 3..6] {
                let scale = wanted[half.clone()].iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                for column in half {
                    let error = (section.row()[column] - wanted[column]).abs();
                    assert!(error <= 1e-12 * scale, "{} column {column}: {error:e}", case.name);
                }
            }
        }
    }
}

#[test]
fn outputs_equal_the_golden_ones_bit_for_bit() {
    for case in golden() {
        let [x, zi, y, zf] = &case.arrays[..] else { panic!("{}", case.name) };
        let sos = Sos::new(&case.rows).unwrap();
        let (mut chunk, mut state) = (x.clone(), zi.clone());
        let along = AlongAxis { outer: 1, len: x.len(), inner: 1 };
        sosfilt_from(&sos, &mut chunk, along, &mut state).unwrap();
        assert_eq!(bits(&chunk), bits(y), "{}", case.name);
        assert_eq!(bits(&state), bits(zf), "{}", case.name);
    }
}

/// Stable sections with poles and zeros anywhere inside the unit circle.
fn any_sos() -> impl Strategy<Value = Sos> {
    let section = (0.0..0.999_f64, 0.0..3.1_f64, 0.0..1.5_f64, 0.0..3.1_f64)
        .prop_map(|(p, u, z, v)| [0.5, -z * v.cos(), 0.5 * z * z, 1.0, -2.0 * p * u.cos(), p * p]);
    prop::collection::vec(section, 1..20).prop_map(|rows| Sos::new(&rows).unwrap())
}

/// Numbers of every size, with zeros and subnormal ones among them.
fn any_signal(len: usize) -> impl Strategy<Value = Vec<f64>> {
    let number =
        prop_oneof![4 => -10.0..10.0_f64, 1 => Just(0.0), 1 => -1e-310..1e-310_f64, 1 => -1e200..1e200_f64];
    prop::collection::vec(number, len)
}

proptest! {
    #[test]
    fn any_split_gives_the_bits_of_the_whole(
        (sos, channels, x) in (any_sos(), 1_usize..12, 0_usize..60)
            .prop_flat_map(|(sos, channels, len)| (Just(sos), Just(channels), any_signal(channels * len))),
        cuts in prop::collection::vec(0.0..1.0_f64, 0..8),
    ) {
        let mut whole = x.clone();
        let mut at_once = SosState::zero(&sos, channels).unwrap();
        at_once.filter(&mut whole).unwrap();

        let len = x.len() / channels;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let mut cuts: Vec<usize> = cuts.iter().map(|cut| (cut * len as f64) as usize).collect();
        cuts.sort_unstable();
        cuts.push(len);
        let (mut pieces, mut state, mut start) = (x, SosState::zero(&sos, channels).unwrap(), 0);
        for cut in cuts {
            state.filter(&mut pieces[start * channels..cut * channels]).unwrap();
            start = cut;
        }
        prop_assert_eq!(bits(&pieces), bits(&whole));
        prop_assert_eq!(bits(state.values()), bits(at_once.values()));
    }

    #[test]
    fn channels_side_by_side_equal_channels_alone(
        (sos, channels, x) in (any_sos(), 2_usize..20, 1_usize..30)
            .prop_flat_map(|(sos, channels, len)| (Just(sos), Just(channels), any_signal(channels * len))),
    ) {
        let mut together = x.clone();
        SosState::zero(&sos, channels).unwrap().filter(&mut together).unwrap();
        for channel in 0..channels {
            let mut alone: Vec<f64> = x.iter().skip(channel).step_by(channels).copied().collect();
            SosState::zero(&sos, 1).unwrap().filter(&mut alone).unwrap();
            let picked: Vec<f64> = together.iter().skip(channel).step_by(channels).copied().collect();
            prop_assert_eq!(bits(&alone), bits(&picked));
        }
    }

    #[test]
    fn an_array_along_an_axis_equals_its_lines(
        (sos, along, x) in (any_sos(), 1_usize..4, 0_usize..20, 1_usize..4).prop_flat_map(|(sos, outer, len, inner)| {
            (Just(sos), Just(AlongAxis { outer, len, inner }), any_signal(outer * len * inner))
        }),
        seed in -1.0..1.0_f64,
    ) {
        let AlongAxis { outer, len, inner } = along;
        let n = sos.sections().len();
        let initial: Vec<f64> = (0..n * outer * 2 * inner).map(|i| seed * (i as f64).sin()).collect();
        let (mut y, mut z) = (x.clone(), initial.clone());
        sosfilt_from(&sos, &mut y, along, &mut z).unwrap();
        for o in 0..outer {
            for i in 0..inner {
                let at = |s: usize, k: usize| ((s * outer + o) * 2 + k) * inner + i;
                let mut state: Vec<f64> = (0..n).flat_map(|s| [initial[at(s, 0)], initial[at(s, 1)]]).collect();
                let mut line: Vec<f64> = (0..len).map(|t| x[(o * len + t) * inner + i]).collect();
                sosfilt_from(&sos, &mut line, AlongAxis { outer: 1, len, inner: 1 }, &mut state).unwrap();
                let picked: Vec<f64> = (0..len).map(|t| y[(o * len + t) * inner + i]).collect();
                prop_assert_eq!(bits(&line), bits(&picked));
                let picked: Vec<f64> = (0..n).flat_map(|s| [z[at(s, 0)], z[at(s, 1)]]).collect();
                prop_assert_eq!(bits(&state), bits(&picked));
            }
        }
        let (mut rest, mut zero) = (x.clone(), vec![0.0; z.len()]);
        sosfilt(&sos, &mut rest, along).unwrap();
        let mut from_zero = x;
        sosfilt_from(&sos, &mut from_zero, along, &mut zero).unwrap();
        prop_assert_eq!(bits(&rest), bits(&from_zero));
    }
}

#[test]
fn long_signals_pass_through_more_sections_than_one_loop_holds() {
    // 20 sections run in groups over stretches of 128 samples; one sample at a time there are no stretches.
    let rows: Vec<[f64; 6]> =
        (0..20).map(|i| [1.0, -1.6, 0.7, 1.0, -1.5 + 0.01 * f64::from(i), 0.6]).collect();
    let sos = Sos::new(&rows).unwrap();
    let x: Vec<f64> = (0..5000).map(|i| (f64::from(i) * 0.37).sin()).collect();
    let mut whole = x.clone();
    SosState::zero(&sos, 1).unwrap().filter(&mut whole).unwrap();
    let (mut one_by_one, mut state) = (x, SosState::zero(&sos, 1).unwrap());
    for sample in one_by_one.chunks_mut(1) {
        state.filter(sample).unwrap();
    }
    assert_eq!(bits(&whole), bits(&one_by_one));
}

#[test]
fn sizes_that_do_not_fit_are_refused() {
    let sos = butterworth(2, Band::Lowpass(10.0), 100.0).unwrap();
    let along = AlongAxis { outer: 2, len: 5, inner: 3 };
    let error = Error::Length { what: "x", expected: 30, got: 29 };
    assert_eq!(sosfilt(&sos, &mut [0.0; 29], along), Err(error.clone()));
    assert_eq!(sosfilt_from(&sos, &mut [0.0; 29], along, &mut [0.0; 12]), Err(error));
    let error = Error::Length { what: "zi", expected: 12, got: 11 };
    assert_eq!(sosfilt_from(&sos, &mut [0.0; 30], along, &mut [0.0; 11]), Err(error));
    assert_eq!(AlongAxis::new(&[2, 3], 2), None);
    assert_eq!(AlongAxis::new(&[2, usize::MAX, 2], 0), None);
    let beyond = AlongAxis { outer: usize::MAX, len: usize::MAX, inner: 2 };
    assert!(matches!(sosfilt(&sos, &mut [0.0; 4], beyond), Err(Error::Length { .. })));
}

#[test]
fn an_empty_array_is_left_alone_whatever_its_other_dimensions() {
    let sos = butterworth(2, Band::Lowpass(10.0), 100.0).unwrap();
    let along = AlongAxis { outer: 0, len: 5, inner: usize::MAX / 8 };
    assert_eq!(sosfilt(&sos, &mut [], along), Ok(()));
    assert_eq!(sosfilt_from(&sos, &mut [], along, &mut []), Ok(()));
}
