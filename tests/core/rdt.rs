//! The sensor's records from outside: every fault is counted as it was made, and counts add up whatever comes.

use granular_id::buffer::{wrench_buffer, BufferSpec, Pushed, Row};
use granular_id::rdt::{Counts, Decoded, Decoder, Record, Scale, Variant};
use granular_id::wrench::{BAD_STATUS, SATURATED};
use proptest::prelude::*;

/// What a decoder makes of records `(rdt, ft)`: the ticks of its rows with the number of their epoch, and the counts of
/// records.
fn placed(records: &[(u32, u32)]) -> (Vec<(u32, u64)>, Counts) {
    let mut decoder = decoder(Variant::NetFt, f64::INFINITY);
    let (mut rows, mut epoch) = (Vec::new(), 0);
    for (rdt_sequence, ft_sequence) in records.iter().copied() {
        let record = Record { rdt_sequence, ft_sequence, status: 0, counts: [0; 6] };
        decoder.datagram(&record.to_bytes(), 0, &mut |decoded| match decoded {
            Decoded::Row(row) => rows.push((epoch, row.ticks)),
            Decoded::NewEpoch => epoch += 1,
        });
    }
    decoder.finish();
    assert_eq!(decoder.counts().datagrams, records.len() as u64);
    (rows, Counts { datagrams: 0, ..*decoder.counts() })
}

/// `count` records from number `rdt` and sample `ft` on, one every `step` samples.
fn run(rdt: u32, ft: u32, step: u32, count: u32) -> Vec<(u32, u32)> {
    (0..count).map(|i| (rdt.wrapping_add(i), ft.wrapping_add(i.wrapping_mul(step)))).collect()
}

#[test]
fn records_lost_before_the_first_are_known() {
    let (rows, counts) = placed(&run(1, 0, 14, 10)[3..]);
    assert_eq!((rows.len(), counts.lost), (7, 3));
    // a stream that was running for long says nothing about its beginning
    assert_eq!(placed(&run(70_000, 0, 14, 10)).1.lost, 0);
}

#[test]
fn a_long_outage_is_counted_as_lost() {
    let whole = run(1, 5, 14, 100_000);
    let (rows, counts) = placed(&[&whole[..100], &whole[90_000..]].concat());
    assert_eq!((counts.lost, counts.restarts, counts.implausible), (89_900, 0, 0));
    assert_eq!(rows[100], (0, 5 + 14 * 90_000));
    // the same beyond the wrap of both numbers
    let whole = run(u32::MAX - 500, u32::MAX - 50_000, 14, 9000);
    let (_, counts) = placed(&[&whole[..100], &whole[8000..]].concat());
    assert_eq!((counts.lost, counts.restarts), (7900, 0));
}

#[test]
fn a_restart_is_a_new_epoch() {
    let after = run(1, 14, 14, 50);
    // early, later, late and with numbers from which 1 seems to lie ahead
    for (rdt, ft, count) in [
        (1, 900_000, 20),
        (1, 900_000, 5000),
        (70_000, 3, 50),
        (u32::MAX - 5, 4_000_000_000, 3),
        (3_000_000_000, 7, 9),
    ] {
        let before = run(rdt, ft, 14, count);
        let (rows, counts) = placed(&[&before[..], &after].concat());
        let total = u64::from(count) + 50;
        assert_eq!(
            counts,
            Counts { records: total, rows: total, restarts: 1, ..Counts::default() },
            "from {rdt}"
        );
        assert_eq!(rows[count as usize], (1, 14));
    }
}

#[test]
fn a_stream_requested_again_is_a_new_epoch() {
    let (rows, counts) = placed(&[run(1, 700, 14, 500), run(1, 700 + 14 * 900, 14, 10)].concat());
    assert_eq!((counts.restarts, counts.lost, counts.rows), (1, 0, 510));
    assert_eq!(rows[500], (1, 700 + 14 * 900));
}

#[test]
fn losses_around_a_restart() {
    let after = run(1, 14, 14, 50);
    let first_lost = [run(1, 900_000, 14, 100), after[2..].to_vec()].concat();
    let counts = placed(&first_lost).1;
    assert_eq!((counts.restarts, counts.lost, counts.rows), (1, 2, 148));
    let mut swapped = after.clone();
    swapped.swap(0, 1);
    let counts = placed(&[run(1, 900_000, 14, 100), swapped].concat()).1;
    assert_eq!((counts.restarts, counts.lost, counts.implausible, counts.rows), (1, 0, 0, 150));
}

#[test]
fn a_stray_record_moves_nothing() {
    for stray in [(0xdead_beef, 0xcafe_babe), (3, 123), (5000, 0), (50, 0)] {
        let mut records = run(1, 900_000, 14, 100);
        records.insert(60, stray);
        let (rows, counts) = placed(&records);
        assert_eq!(
            (counts.implausible, counts.restarts, counts.lost, rows.len()),
            (1, 0, 0, 100),
            "{stray:?}"
        );
    }
    // at the end there is nothing that could confirm it
    assert_eq!(placed(&[run(1, 0, 14, 9), vec![(77_000, 3)]].concat()).1.implausible, 1);
    // and twice the same is no confirmation
    let twice = [run(1, 0, 14, 9), vec![(77_000, 3); 2], run(10, 126, 14, 9)].concat();
    let counts = placed(&twice).1;
    assert_eq!((counts.implausible, counts.duplicates, counts.restarts), (1, 1, 0));
}

#[test]
fn a_stray_record_begins_no_stream() {
    for stray in [(0xdead_beef, 0xcafe_babe), (0, 0), (3, 123), (0, 700), (1, 0)] {
        let records = [vec![stray], run(1, 900_000, 14, 100)].concat();
        let (rows, counts) = placed(&records);
        let wanted = Counts { records: 101, rows: 100, implausible: 1, ..Counts::default() };
        assert_eq!((rows[0], counts), ((0, 900_000), wanted), "{stray:?}");
    }
    // alone it is none, nor is it by coming twice
    for times in [1, 2] {
        let (rows, counts) = placed(&vec![(7, 98); times]);
        assert_eq!((rows.len(), counts.implausible), (0, 1));
    }
}

#[test]
fn the_first_record_waits_until_the_second_confirms_it() {
    let mut decoder = decoder(Variant::NetFt, f64::INFINITY);
    let mut rows = Vec::new();
    for (i, host_ns) in [(1, 100), (2, 200), (3, 300)] {
        decoder.datagram(&record(i, 0, 0), host_ns, &mut |decoded| {
            if let Decoded::Row(row) = decoded {
                rows.push((row.ticks, row.host_ns));
            }
        });
        assert_eq!((rows.len(), decoder.is_waiting()), if i == 1 { (0, true) } else { (i as usize, false) });
    }
    assert_eq!(rows, [(14, 100), (28, 200), (42, 300)]);
    // in whatever order the two come, also as one sample under two numbers
    assert_eq!(placed(&[(2, 28), (1, 14), (3, 42)]).0, [(0, 14), (0, 28), (0, 42)]);
    let (rows, counts) = placed(&[(1, 14), (2, 14), (3, 42)]);
    assert_eq!((rows, counts.stale, counts.lost), (vec![(0, 14), (0, 42)], 1, 0));
}

#[test]
fn a_sample_under_a_new_number_is_stale() {
    let (rows, counts) = placed(&[(1, 14), (2, 28), (3, 28), (4, 42), (5, 56)]);
    assert_eq!(rows, [(0, 14), (0, 28), (0, 42), (0, 56)]);
    assert_eq!((counts.stale, counts.lost), (1, 0));
}

#[test]
fn a_known_sample_under_a_lost_number_is_a_duplicate_in_the_buffer() {
    let (rows, counts) = placed(&[(1, 14), (2, 28), (4, 56), (3, 28)]);
    assert_eq!((counts.reordered, counts.lost), (1, 0));
    let (mut writer, _) = wrench_buffer(BufferSpec::default().with_tick_hz(7000.0)).unwrap();
    let mut push = |ticks| writer.push_in_epoch(&Row { ticks, host_ns: 0, wrench: [0.0; 6], flags: 0 });
    let pushed: Vec<_> = rows.into_iter().map(|(_, ticks)| push(ticks)).collect();
    assert_eq!(pushed, [Pushed::Written, Pushed::Written, Pushed::Written, Pushed::Duplicate]);
}

fn decoder(variant: Variant, limit: f64) -> Decoder {
    Decoder::new(variant, Scale::new(1e6, 1e6).unwrap(), [limit; 6])
}

fn record(rdt_sequence: u32, status: u32, count: i32) -> [u8; 36] {
    Record { rdt_sequence, ft_sequence: 14 * rdt_sequence, status, counts: [count; 6] }.to_bytes()
}

fn decoded(decoder: &mut Decoder, datagrams: &[&[u8]]) -> Vec<(f64, u8)> {
    let mut rows = Vec::new();
    for datagram in datagrams {
        decoder.datagram(datagram, 5, &mut |decoded| {
            if let Decoded::Row(row) = decoded {
                assert_eq!(row.host_ns, 5);
                rows.push((row.wrench[0], row.flags));
            }
        });
    }
    rows
}

#[test]
fn rows_have_units_and_flags() {
    let mut decoder = decoder(Variant::NetFt, f64::INFINITY);
    let statuses = [0, 0x8000_0001, 0x8002_0000, 0x8001_0000, 0];
    let mut datagrams: Vec<_> =
        (1..).zip(statuses).map(|(i, status)| record(i, status, -1_500_000)).collect();
    datagrams[4] = record(5, 0, i32::MIN);
    let datagrams: Vec<&[u8]> = datagrams.iter().map(|bytes| &bytes[..]).collect();
    let both = BAD_STATUS | SATURATED;
    let wanted = [(-1.5, 0), (-1.5, BAD_STATUS), (-1.5, both), (-1.5, 0), (-2_147.483_648, SATURATED)];
    assert_eq!(decoded(&mut decoder, &datagrams), wanted);
    let Counts { bad_status, saturated, warnings, .. } = *decoder.counts();
    assert_eq!((bad_status, saturated, warnings), (2, 2, 1));
}

#[test]
fn buffered_datagrams_hold_many() {
    let mut decoder = decoder(Variant::NetFt, f64::INFINITY);
    let datagram: Vec<u8> = (1..=40).flat_map(|i| record(i, 0, 0)).collect();
    let longer: Vec<u8> = (41..=81).flat_map(|i| record(i, 0, 0)).collect();
    assert_eq!(decoded(&mut decoder, &[&datagram, &longer, &longer[..35], &[]]).len(), 40);
    let Counts { datagrams, malformed, records, rows, lost, .. } = *decoder.counts();
    assert_eq!((datagrams, malformed, records, rows, lost), (4, 3, 40, 40, 0));
}

#[test]
fn forces_beyond_sense_are_rejected_with_their_numbers() {
    let mut decoder = decoder(Variant::NetFt, 100.0);
    let rows = decoded(
        &mut decoder,
        &[&record(1, 0, 0), &record(900, 0, 100_000_001), &record(2, 0, 100_000_000), &record(3, 0, 0)],
    );
    assert_eq!(rows.len(), 3);
    let Counts { out_of_range, lost, implausible, .. } = *decoder.counts();
    assert_eq!((out_of_range, lost, implausible), (1, 0, 0));
}

/// What is done to a record on its way.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    Fine,
    Lost,
    Again { later: usize },
    Late { by: usize },
    StrayBefore { rdt: u32, ft: u32 },
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        6 => Just(Fate::Fine),
        1 => Just(Fate::Lost),
        1 => (0..80_usize).prop_map(|later| Fate::Again { later }),
        1 => (1..60_usize).prop_map(|by| Fate::Late { by }),
        1 => any::<(u32, u32)>().prop_map(|(rdt, ft)| Fate::StrayBefore { rdt, ft }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn faults_are_counted_as_they_were_made(
        fates in prop::collection::vec(fate(), 0..400),
        start in prop_oneof![Just(1_u32), Just(u32::MAX - 150), Just(500_000_000)],
        ft in prop_oneof![any::<u32>(), Just(u32::MAX - 500)],
        step in 1..200_u32,
        stray in prop::option::of(any::<(u32, u32)>()),
    ) {
        // Clean ends: what is missing there is known to nobody.
        let first = stray.map_or(Fate::Fine, |(rdt, ft)| Fate::StrayBefore { rdt, ft });
        let fates = [vec![first, Fate::Fine], fates, vec![Fate::Fine; 100]].concat();
        let records = run(start, ft, step, u32::try_from(fates.len()).unwrap());
        let mut arriving = Vec::new();
        let mut wanted = Counts::default();
        for (i, (fate, record)) in fates.iter().zip(&records).enumerate() {
            match *fate {
                Fate::Fine => arriving.push((2 * i, *record)),
                Fate::Lost => wanted.lost += 1,
                Fate::Again { later } => {
                    arriving.extend([(2 * i, *record), (2 * (i + later), *record)]);
                    wanted.duplicates += 1;
                }
                Fate::Late { by } => arriving.push((2 * (i + by) + 1, *record)),
                // A stray one must not look like part of the stream, nor confirm the one before.
                Fate::StrayBefore { rdt, ft } => {
                    let away = |a: u32, b: u32| a.wrapping_sub(b).cast_signed().unsigned_abs() > 70_000;
                    let others = arriving.iter().map(|(_, record): &(usize, (u32, u32))| *record);
                    if others.chain([*record]).all(|other| away(rdt, other.0) && away(ft, other.1)) {
                        arriving.push((2 * i, (rdt, ft)));
                        wanted.implausible += 1;
                    }
                    arriving.push((2 * i, *record));
                }
            }
        }
        arriving.sort_by_key(|(when, _)| *when);
        let arriving: Vec<_> = arriving.into_iter().map(|(_, record)| record).collect();
        // Late: first arrivals behind a higher number.
        let place = |record: &(u32, u32)| records.iter().position(|known| known == record);
        let (mut highest, mut ticks) = (None, Vec::new());
        for at in arriving.iter().filter_map(place) {
            if highest.is_some_and(|highest| at < highest) && !ticks.contains(&at) {
                wanted.reordered += 1;
            }
            if !ticks.contains(&at) {
                ticks.push(at);
            }
            highest = highest.max(Some(at));
        }
        wanted.records = arriving.len() as u64;
        wanted.rows = ticks.len() as u64;
        let (rows, counts) = placed(&arriving);
        prop_assert_eq!(counts, wanted);
        let ticks: Vec<_> =
            ticks.iter().map(|at| (0, u64::from(ft) + u64::from(step) * *at as u64)).collect();
        prop_assert_eq!(rows, ticks);
    }

    #[test]
    fn counts_add_up_whatever_comes(
        records in prop::collection::vec((0..40_u32, 0..60_u32), 0..300),
        offset in any::<(u32, u32)>(),
    ) {
        let records: Vec<_> = records
            .iter()
            .map(|(rdt, ft)| (rdt.wrapping_add(offset.0), ft.wrapping_mul(7).wrapping_add(offset.1)))
            .collect();
        let (rows, counts) = placed(&records);
        let Counts { rows: n_rows, duplicates, stale, implausible, out_of_range, .. } = counts;
        prop_assert_eq!(counts.records, n_rows + duplicates + stale + implausible + out_of_range);
        prop_assert_eq!(rows.len() as u64, n_rows);
    }
}
