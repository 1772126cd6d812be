//! Any datagrams, in any order: nothing panics, every record is accounted for, rows make sense, and the buffer hands each
//! sample on once, in the order of time.

#![no_main]

use granular_id::buffer::{wrench_buffer, BufferSpec, BufferedRow};
use granular_id::rdt::{records, Counts, Decoded, Decoder, Record, Scale, Variant};
use libfuzzer_sys::fuzz_target;

const VARIANTS: [Variant; 3] = [Variant::NetFt, Variant::Axia, Variant::OnRobot];

/// Takes datagrams from the fuzzer's bytes: raw ones, and records near the last one, which random bytes never are.
fn datagrams(mut bytes: &[u8], mut take: impl FnMut(&[u8])) {
    let (mut rdt, mut ft) = (1_u32, 700_u32);
    while let Some((&kind, rest)) = bytes.split_first() {
        bytes = rest;
        if kind == 255 {
            let length = bytes.first().map_or(0, |first| usize::from(*first) * 6);
            let (datagram, rest) = bytes.split_at(length.min(bytes.len()));
            take(datagram);
            bytes = rest;
            continue;
        }
        let Some((change, rest)) = bytes.split_first_chunk::<2>() else { return };
        bytes = rest;
        let [first, second] = change.map(u32::from);
        let back = kind & 1 == 1;
        let step = |value: u32, by: u32| if back { value.wrapping_sub(by) } else { value.wrapping_add(by) };
        match kind >> 1 & 7 {
            0 => (rdt, ft) = (step(rdt, first), step(ft, second)),
            1 => (rdt, ft) = (step(rdt, first << 8), step(ft, second << 12)),
            2 => (rdt, ft) = (step(rdt, first << 24), step(ft, second << 24)),
            3 => (rdt, ft) = (first, second),
            _ => (rdt, ft) = (rdt.wrapping_add(1), ft.wrapping_add(14)),
        }
        let status = u32::from(kind >> 4) << 28 | second << 16;
        let counts = [i32::MIN, i32::MAX, first.cast_signed(), -1, 0, second.cast_signed() << 20];
        let count = 1 + usize::from(kind & 16 == 16) * usize::from(kind >> 5);
        let mut datagram = Vec::new();
        for _ in 0..count {
            let record = Record { rdt_sequence: rdt, ft_sequence: ft, status, counts };
            datagram.extend(record.to_bytes());
            (rdt, ft) = (rdt.wrapping_add(1), ft.wrapping_add(14));
        }
        take(&datagram);
    }
}

fuzz_target!(|data: &[u8]| {
    let Some((&settings, data)) = data.split_first() else { return };
    let scale = Scale::new(1e6, 1e3).expect("a usual scale");
    let limit = if settings & 4 == 0 { f64::INFINITY } else { 1000.0 };
    let mut decoder = Decoder::new(VARIANTS[usize::from(settings & 3) % 3], scale, [limit; 6]);
    let (mut given, mut whole, mut within, mut rows, mut epochs) = (0_u64, 0_u64, 0_u64, 0_u64, 0_u64);
    // Rows of a datagram, and those that wait, fit many times.
    let depth = usize::from(settings >> 3);
    let spec = BufferSpec::default().with_seconds(0.5).with_tick_hz(7000.0).with_reorder_depth(depth);
    let (mut writer, mut reader) = wrench_buffer(spec).expect("a usual buffer");
    let (mut read, mut newest, mut written) = ([BufferedRow::EMPTY; 250], None, 0);
    datagrams(data, |datagram| {
        given += 1;
        if let Some(records) = records(datagram) {
            whole += 1;
            within += records.count() as u64;
        }
        decoder.datagram(datagram, given, &mut |decoded| match decoded {
            Decoded::Row(row) => {
                rows += 1;
                assert!(row.wrench.iter().all(|value| value.is_finite() && value.abs() <= limit));
                assert!(row.host_ns <= given);
                writer.push_in_epoch(&row);
            }
            Decoded::NewEpoch => {
                epochs += 1;
                writer.new_epoch();
            }
        });
        while reader.n_ahead() > 0 {
            let taken = reader.read(&mut read).expect("six axes");
            assert_eq!(taken.missed, 0);
            for row in &read[..taken.n_rows] {
                // later than all before, of this epoch or of one before it
                assert!(newest.replace((row.epoch, row.row.ticks)) < Some((row.epoch, row.row.ticks)));
                written += 1;
            }
        }
        let waiting = u64::from(decoder.is_waiting());
        let Counts { records, rows, duplicates, stale, implausible, out_of_range, .. } = *decoder.counts();
        assert_eq!(records, rows + duplicates + stale + implausible + out_of_range + waiting);
    });
    decoder.finish();
    writer.flush();
    let stats = reader.stats();
    assert_eq!(rows, stats.written + stats.duplicates + stats.late);
    assert!(written <= stats.written && epochs >= stats.epochs);
    let counts = *decoder.counts();
    assert_eq!((counts.datagrams, counts.malformed, counts.records), (given, given - whole, within));
    assert_eq!((counts.rows, counts.restarts), (rows, epochs));
    assert!(counts.reordered <= rows && counts.warnings <= rows && counts.bad_status <= rows);
    assert_eq!(within, rows + counts.duplicates + counts.stale + counts.implausible + counts.out_of_range);
});
