//! The buffer from outside: sizes that are refused, what begins an epoch, readers of their own.

use granular_id::buffer::{
    host_ns, wrench_buffer, BufferSpec, BufferedRow, Fill, Pushed, Reader, Row, WindowError, WindowSpec,
    Writer, MAX_REORDER_DEPTH, MAX_ROWS,
};
use granular_id::wrench::{KNOWN_FLAGS, SAMPLE_FLAGS, SATURATED};
use granular_id::Error;

/// A buffer of `capacity` rows in which a tick is a period.
fn buffer(capacity: usize, reorder_depth: usize) -> (Writer, Reader) {
    let seconds = capacity as f64 / 500.0;
    wrench_buffer(BufferSpec { seconds, tick_hz: 500.0, reorder_depth, ..BufferSpec::default() }).unwrap()
}

fn row(ticks: u64) -> Row {
    Row { ticks, host_ns: ticks, wrench: [ticks as f64; 6], flags: 0 }
}

fn push(writer: &mut Writer, ticks: impl IntoIterator<Item = u64>) -> Vec<Pushed> {
    ticks.into_iter().map(|ticks| writer.push(&row(ticks))).collect()
}

/// Ticks of the rows that one read brings.
fn read(reader: &mut Reader) -> Vec<u64> {
    let mut ticks = Vec::new();
    reader.read_each(usize::MAX, |row| ticks.push(row.row.ticks));
    ticks
}

#[test]
fn sizes_and_rates_out_of_range_are_refused() {
    let refused = |change: &dyn Fn(&mut BufferSpec)| {
        let mut spec = BufferSpec::default();
        change(&mut spec);
        wrench_buffer(spec).err().unwrap()
    };
    for rate_hz in [0.0, -1.0, f64::INFINITY] {
        assert_eq!(refused(&|spec| spec.rate_hz = rate_hz), Error::Rate { rate_hz });
    }
    for tick_hz in [0.0, 499.9, f64::INFINITY] {
        assert_eq!(refused(&|spec| spec.tick_hz = tick_hz), Error::TickRate { tick_hz, rate_hz: 500.0 });
    }
    for seconds in [0.0, -1.0, f64::INFINITY, (MAX_ROWS + 1) as f64 / 500.0] {
        assert_eq!(refused(&|spec| spec.seconds = seconds), Error::BufferSize { seconds, rate_hz: 500.0 });
    }
    let reorder_depth = MAX_REORDER_DEPTH + 1;
    assert_eq!(refused(&|spec| spec.reorder_depth = reorder_depth), Error::ReorderDepth { reorder_depth });
    for message in [
        refused(&|spec| spec.rate_hz = f64::NAN),
        refused(&|spec| spec.tick_hz = f64::NAN),
        refused(&|spec| spec.seconds = f64::NAN),
    ] {
        assert!(message.to_string().contains("got NaN"), "{message}");
    }
}

#[test]
fn capacity_is_seconds_times_rate_rounded_up() {
    for (seconds, capacity) in [(1e-9, 1), (0.002, 1), (0.0021, 2), (10.0, 5000)] {
        let (_, reader) = wrench_buffer(BufferSpec { seconds, ..BufferSpec::default() }).unwrap();
        assert_eq!(reader.capacity(), capacity);
    }
}

#[test]
fn readers_get_the_newest_capacity_rows() {
    let (mut writer, mut reader) = buffer(5, 0);
    let mut twin = reader.clone();
    push(&mut writer, 0..12);
    let mut rows = [BufferedRow::EMPTY; 9];
    let taken = reader.read(&mut rows);
    assert_eq!((taken.n_rows, taken.missed), (5, 7));
    assert_eq!(rows.map(|row| row.row.ticks)[..5], [7, 8, 9, 10, 11]);
    assert_eq!(read(&mut twin), [7, 8, 9, 10, 11], "a clone has a place of its own");
    assert_eq!(reader.from_now().n_ahead(), 0);
    assert_eq!(read(&mut reader.from_oldest()), [7, 8, 9, 10, 11]);
}

#[test]
fn a_late_row_finds_its_place_within_the_depth() {
    let (mut writer, mut reader) = buffer(20, 3);
    let pushed = push(&mut writer, [0, 1, 3, 5, 4, 2]);
    assert_eq!(pushed[2..5], [Pushed::Held; 3]);
    assert_eq!(pushed[5], Pushed::Written);
    assert_eq!(read(&mut reader), [0, 1, 2, 3, 4, 5]);
    assert_eq!((reader.stats().reordered, reader.stats().gaps, reader.stats().held), (2, 0, 0));
    // Row 6 never comes: the fourth that would wait for it ends the wait.
    assert_eq!(push(&mut writer, [7, 8, 9])[2], Pushed::Held);
    assert_eq!(reader.n_ahead(), 0);
    assert_eq!(push(&mut writer, [10, 6]), [Pushed::Written, Pushed::Late]);
    assert_eq!(read(&mut reader), [7, 8, 9, 10]);
}

#[test]
fn what_waits_is_written_when_nothing_more_comes() {
    let (mut writer, mut reader) = buffer(20, 3);
    push(&mut writer, [0, 2]);
    assert_eq!(reader.stats().held, 1);
    writer.flush();
    assert_eq!((read(&mut reader), reader.stats().held), (vec![0, 2], 0));
}

#[test]
fn a_jump_back_of_more_than_a_second_is_a_restart() {
    let (mut writer, mut reader) = buffer(20, 0);
    push(&mut writer, [1000, 1001]);
    assert_eq!(push(&mut writer, [501]), [Pushed::Late]);
    assert_eq!(push(&mut writer, [500]), [Pushed::Written]);
    assert_eq!(read(&mut reader), [1000, 1001]);
    assert_eq!(read(&mut reader), [500], "never in one read with the epoch before");
    assert_eq!((reader.stats().epochs, reader.stats().late, reader.latest().unwrap().epoch), (1, 1, 1));
}

#[test]
fn a_restart_may_repeat_the_times_before_it() {
    let (mut writer, reader) = buffer(5000, 0);
    push(&mut writer, 0..2500);
    assert_eq!(push(&mut writer, 0..600), [Pushed::Written; 600]);
    assert_eq!((reader.stats().epochs, reader.stats().duplicates), (1, 0));
}

#[test]
fn a_sender_that_tells_restarts_has_late_rows_only() {
    let (mut writer, reader) = buffer(5000, 0);
    push(&mut writer, 2000..2100);
    for ticks in (0..20).chain(1000..1040) {
        assert_eq!(writer.push_in_epoch(&row(ticks)), Pushed::Late);
    }
    assert_eq!(writer.push_in_epoch(&row(2050)), Pushed::Duplicate);
    assert_eq!(writer.push_in_epoch(&row(2100)), Pushed::Written);
    assert_eq!((reader.stats().epochs, reader.stats().late), (0, 60));
}

#[test]
fn eight_late_rows_in_a_row_are_a_restart() {
    let (mut writer, reader) = buffer(50, 0);
    push(&mut writer, 100..103);
    let mut pushed = push(&mut writer, 0..9);
    assert_eq!(pushed.split_off(7), [Pushed::Written, Pushed::Written]);
    assert_eq!(pushed, [Pushed::Late; 7]);
    assert_eq!(reader.stats().epochs, 1);
    // One good row between late ones: the way, not the device.
    let (mut writer, reader) = buffer(50, 0);
    push(&mut writer, (0..40).flat_map(|n| [100 + n, n]));
    assert_eq!((reader.stats().epochs, reader.stats().late), (0, 40));
}

#[test]
fn a_new_epoch_without_rows_is_none() {
    let (mut writer, mut reader) = buffer(20, 0);
    writer.new_epoch();
    push(&mut writer, [5]);
    writer.new_epoch();
    writer.new_epoch();
    push(&mut writer, [5]);
    assert_eq!((writer.epoch(), reader.stats().epochs), (1, 1));
    assert_eq!((read(&mut reader), read(&mut reader)), (vec![5], vec![5]));
}

#[test]
fn windows_refuse_with_the_reason() {
    let (mut writer, reader) = buffer(20, 0);
    let refused = |spec: WindowSpec| reader.window(&spec).unwrap_err();
    assert_eq!(refused(WindowSpec::whole(1)), WindowError::TooFew { n: 1, have: 0 });
    push(&mut writer, [0, 1, 4, 5]);
    assert_eq!(refused(WindowSpec::whole(21)), WindowError::TooLong { n: 21, capacity: 20 });
    assert_eq!(refused(WindowSpec::whole(3)), WindowError::Gap { missing: 2, max_gap: 0, ago: 1 });
    let filled = WindowSpec { fill: Fill::Linear, max_gap: 2, ..WindowSpec::whole(5) };
    let window = reader.window(&filled).unwrap();
    assert_eq!(window.mask, [true, false, false, true, true]);
    assert_eq!(window.wrench.iter().map(|row| row[0]).collect::<Vec<_>>(), [1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(refused(WindowSpec { n: 7, ..filled }), WindowError::TooFew { n: 7, have: 6 });
    writer.push(&Row { flags: SATURATED, ..row(6) });
    push(&mut writer, [7]);
    assert_eq!(refused(WindowSpec::whole(2)), WindowError::Saturated { ago: 1 });
    assert!(reader.window(&WindowSpec { allow_saturated: true, ..WindowSpec::whole(2) }).is_ok());
    writer.new_epoch();
    push(&mut writer, [0]);
    assert_eq!(refused(WindowSpec::whole(2)), WindowError::EpochBorder { n: 2, have: 1 });
    assert!(reader.window(&WindowSpec::whole(0)).unwrap().mask.is_empty());
}

#[test]
fn a_gap_longer_than_can_be_counted_stays_a_gap() {
    let (mut writer, reader) = buffer(20, 0);
    push(&mut writer, [0, u64::MAX]);
    assert_eq!(reader.latest().unwrap().missing_before, u32::MAX);
    let all = WindowSpec { max_gap: u32::MAX, fill: Fill::Linear, ..WindowSpec::whole(20) };
    assert_eq!(reader.window(&all).unwrap().mask.iter().filter(|measured| **measured).count(), 1);
}

#[test]
fn host_time_never_runs_back() {
    let times: Vec<_> = (0..1000).map(|_| host_ns()).collect();
    assert!(times.is_sorted());
}

#[test]
fn flags_are_single_bits_that_differ() {
    assert!(SAMPLE_FLAGS.iter().all(|(_, bit)| bit.is_power_of_two()));
    assert_eq!(SAMPLE_FLAGS.iter().map(|(_, bit)| u32::from(*bit)).sum::<u32>(), u32::from(KNOWN_FLAGS));
}
