//! The buffer from outside: sizes that are refused, what begins an epoch, readers of their own; host time from device time
//! with clocks that drift, rows that are late, steps and restarts.

use granular_id::buffer::{
    host_ns, wrench_buffer, BufferSpec, BufferedRow, DeviceClock, Fill, Pushed, Reader, Row, WindowSpec,
    Writer, MAX_AXES, MAX_REORDER_DEPTH, MAX_ROWS,
};
use granular_id::wrench::{KNOWN_FLAGS, SAMPLE_FLAGS};
use granular_id::Error;

/// A buffer of `capacity` rows in which a tick is a period.
fn buffer(capacity: usize, reorder_depth: usize) -> (Writer, Reader) {
    let seconds = capacity as f64 / 500.0;
    wrench_buffer(
        BufferSpec::default().with_seconds(seconds).with_tick_hz(500.0).with_reorder_depth(reorder_depth),
    )
    .unwrap()
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
    let values = |values: &[f64]| [values, &[0.0, -1.0, f64::INFINITY, f64::NAN]].concat();
    for rate_hz in values(&[]) {
        assert!(matches!(refused(&|spec| spec.rate_hz = rate_hz), Error::Argument { what: "rate_hz", .. }));
    }
    for tick_hz in values(&[499.9]) {
        assert!(matches!(refused(&|spec| spec.tick_hz = tick_hz), Error::Argument { what: "tick_hz", .. }));
    }
    for seconds in values(&[(MAX_ROWS + 1) as f64 / 500.0]) {
        assert!(matches!(refused(&|spec| spec.seconds = seconds), Error::Argument { what: "seconds", .. }));
    }
    let deep = refused(&|spec| spec.reorder_depth = MAX_REORDER_DEPTH + 1);
    assert!(matches!(deep, Error::Range { what: "reorder_depth", max: MAX_REORDER_DEPTH, .. }));
    for n_axes in [0, MAX_AXES + 1] {
        let error = Error::Range { what: "n_axes", got: n_axes, min: 1, max: MAX_AXES };
        assert_eq!(refused(&|spec| spec.n_axes = n_axes), error);
    }
}

#[test]
fn capacity_is_seconds_times_rate_rounded_up() {
    for (seconds, capacity) in [(1e-9, 1), (0.002, 1), (0.0021, 2), (10.0, 5000)] {
        let (_, reader) = wrench_buffer(BufferSpec::default().with_seconds(seconds)).unwrap();
        assert_eq!(reader.capacity(), capacity);
    }
}

#[test]
fn rows_may_have_any_number_of_axes() {
    for n_axes in [1, 3, 12, MAX_AXES] {
        let spec = BufferSpec::default().with_seconds(0.01).with_tick_hz(500.0).with_reorder_depth(2);
        let (mut writer, mut reader) = wrench_buffer(spec.with_n_axes(n_axes)).unwrap();
        let values =
            |ticks: u64| (0..n_axes).map(|axis| (100 * ticks) as f64 + axis as f64).collect::<Vec<_>>();
        for ticks in [0, 2, 3, 1, 5, 6, 7, 8] {
            writer.push(&row(ticks).with(values(ticks)));
        }
        let mut got = Vec::new();
        let taken = reader.read_each(9, |row| got.push((row.row.ticks, row.row.wrench.to_vec())));
        assert_eq!((taken.missed, got), (3, [3, 5, 6, 7, 8].map(|ticks| (ticks, values(ticks))).to_vec()));
        assert_eq!(reader.latest().map(|row| row.row.wrench.to_vec()), Some(values(8)));
        let spec = WindowSpec::whole(5).with_fill(Fill::Linear).with_max_gap(1);
        assert_eq!(reader.window(&spec).unwrap().wrench, (4..9).flat_map(values).collect::<Vec<_>>());
        assert_eq!(writer.push(&row(9).with(vec![0.0; n_axes + 1])), Pushed::WrongLength);
        let error = Error::Length { what: "wrench", expected: n_axes, got: 6 };
        assert_eq!(reader.read(&mut [BufferedRow::EMPTY]), Err(error));
    }
    let (mut writer, mut reader) = wrench_buffer(BufferSpec::default().with_n_axes(2)).unwrap();
    writer.push(&row(0).with([1.0, 2.0]));
    let mut rows = [BufferedRow::EMPTY.with([0.0; 2])];
    assert_eq!((reader.read(&mut rows).unwrap().n_rows, rows[0].row.wrench), (1, [1.0, 2.0]));
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
fn a_gap_longer_than_can_be_counted_stays_a_gap() {
    let (mut writer, mut reader) = buffer(20, 0);
    push(&mut writer, [0, u64::MAX]);
    assert_eq!(reader.latest().unwrap().missing_before, u32::MAX);
    let all = WindowSpec::whole(20).with_max_gap(u32::MAX).with_fill(Fill::Linear);
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

const PERIOD_NS: u64 = 2_000_000;

/// A device whose clock differs from the host's, and the way its rows take.
struct Device {
    writer: Writer,
    reader: Reader,
    /// Host time per device time.
    rate: f64,
    seed: u64,
}

/// Where the device's clock and the host's stand at the first row.
const ORIGIN_TICKS: u64 = 1 << 50;
const ORIGIN_HOST_NS: u64 = 5_000_000_000;

impl Device {
    fn new(rate: f64) -> Self {
        let (writer, reader) = wrench_buffer(BufferSpec::default()).unwrap();
        Self { writer, reader, rate, seed: 1 }
    }

    /// From 0 to 1.
    fn uniform(&mut self) -> f64 {
        self.seed = self.seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.seed >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Delay of a row that meets no trouble: 50 us and an exponential tail.
    fn usual_delay_ns(&mut self) -> f64 {
        50_000.0 - 100_000.0 * (1.0 - self.uniform()).ln()
    }

    /// Host time at which row `n` was measured.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn measured_ns(&self, n: u64) -> u64 {
        ORIGIN_HOST_NS + (self.rate * (n * PERIOD_NS) as f64).round() as u64
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn push(&mut self, n: u64, delay_ns: f64) -> u64 {
        let host_ns = self.measured_ns(n) + delay_ns.round() as u64;
        self.writer.push(&Row { host_ns, ..row(ORIGIN_TICKS + n * PERIOD_NS) });
        host_ns
    }

    /// Error of the mapped arrival of row `n`: 50 us after it was measured is right.
    fn error_ns(&self, n: u64) -> f64 {
        let ideal = self.measured_ns(n) as f64 + 50_000.0;
        self.reader.host_ns_at(ORIGIN_TICKS + n * PERIOD_NS).unwrap() - ideal
    }
}

#[test]
fn before_the_first_row_there_is_no_time() {
    let (_, reader) = wrench_buffer(BufferSpec::default()).unwrap();
    assert_eq!((reader.lag_ns(0), reader.host_ns_at(0), reader.ticks_at(0)), (None, None, None));
}

#[test]
fn drift_and_delays_are_followed() {
    for rate in [1.0, 1.0 + 200e-6, 1.0 - 200e-6, 1.01] {
        let mut device = Device::new(rate);
        let mut worst: f64 = 0.0;
        // Two minutes; every second and a half the host is busy for 50 ms and sees the rows in one go.
        for n in 0..60_000 {
            let busy = (n % 750) < 25 && n > 750;
            let delay = if busy { (25 - n % 750) as f64 * PERIOD_NS as f64 } else { device.usual_delay_ns() };
            device.push(n, delay);
            if n > 500 {
                worst = worst.max(device.error_ns(n).abs());
            }
        }
        assert!(worst < 300_000.0, "rate {rate}: {worst} ns");
    }
}

#[test]
fn a_stall_of_the_way_is_lag_although_rows_keep_coming() {
    let mut device = Device::new(1.0 + 50e-6);
    for n in 0..10_000 {
        let delay = device.usual_delay_ns();
        let now = device.push(n, delay);
        let lag = device.reader.lag_ns(now).unwrap();
        assert!((-1.0..3e6).contains(&lag), "{lag}");
    }
    for n in 10_000..15_000 {
        let now = device.push(n, 80e6);
        let lag = device.reader.lag_ns(now).unwrap();
        assert!((lag - 79.95e6).abs() < 0.3e6, "row {n}: {lag}");
    }
}

#[test]
fn without_new_rows_lag_grows_with_the_time() {
    let mut device = Device::new(1.0);
    let now = (0..1000).map(|n| device.push(n, 0.0)).last().unwrap();
    for later in [0, 1, 20_000_000, 3_600_000_000_000] {
        assert_eq!(device.reader.lag_ns(now + later), Some(later as f64));
    }
    assert_eq!(device.reader.lag_ns(now - 500), Some(-500.0), "a moment before the newest row");
}

#[test]
fn both_ways_give_the_same_moment() {
    let mut device = Device::new(1.0 + 300e-6);
    for n in 0..5000 {
        let delay = device.usual_delay_ns();
        device.push(n, delay);
    }
    for n in [0, 1, 2500, 4999, 6000] {
        let host_ns = device.reader.host_ns_at(ORIGIN_TICKS + n * PERIOD_NS).unwrap();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let ticks = device.reader.ticks_at(host_ns.round() as u64).unwrap();
        assert!((ticks - (ORIGIN_TICKS + n * PERIOD_NS) as f64).abs() <= 2.0, "row {n}");
    }
}

#[test]
fn a_step_of_the_device_clock_begins_anew() {
    let mut device = Device::new(1.0);
    for n in 0..5000 {
        device.push(n, 0.0);
    }
    // Ten seconds forward at once, within an epoch: rows go on at the usual pace of the host.
    for n in 5000..5100 {
        let ticks = ORIGIN_TICKS + (n + 5000) * PERIOD_NS;
        let host_ns = device.measured_ns(n);
        device.writer.push(&Row { host_ns, ..row(ticks) });
        assert_eq!(device.reader.lag_ns(host_ns), Some(0.0));
    }
}

#[test]
fn a_new_epoch_has_a_clock_of_its_own() {
    let mut device = Device::new(1.0);
    for n in 0..1000 {
        device.push(n, 30e6);
    }
    device.writer.new_epoch();
    let first = Row { host_ns: 77_000_000_000, ..row(0) };
    device.writer.push(&first);
    assert_eq!(device.reader.lag_ns(first.host_ns + 5), Some(5.0));
    assert_eq!(device.reader.host_ns_at(PERIOD_NS), Some((first.host_ns + PERIOD_NS) as f64));
}

#[test]
fn replays_at_another_speed_have_no_lag() {
    for speed in [0.1, 10.0, 1000.0] {
        let mut device = Device::new(1.0 / speed);
        for n in 0..20_000 {
            let now = device.push(n, 0.0);
            let lag = device.reader.lag_ns(now).unwrap();
            assert!(lag.abs() < 1e6, "speed {speed}, row {n}: {lag}");
        }
    }
}

#[test]
fn many_rows_at_one_moment_are_no_trouble() {
    let mut device = Device::new(0.0);
    for n in 0..5000 {
        let now = device.push(n, 0.0);
        assert!(device.reader.lag_ns(now).unwrap().abs() < 1.0);
    }
    assert!(device.reader.ticks_at(ORIGIN_HOST_NS).is_none_or(f64::is_finite), "host time stands still");
}

/// Pushes rows with these times, or none, as they come; their times by the clock.
fn push_by_clock(
    clock: &mut DeviceClock,
    writer: &mut Writer,
    times: impl IntoIterator<Item = Option<u64>>,
) -> Vec<u64> {
    let push = |own| {
        let ticks = clock.ticks(own, writer);
        writer.push(&row(ticks));
        ticks
    };
    times.into_iter().map(push).collect()
}

#[test]
fn rows_without_time_follow_one_period_apart_without_drift() {
    for (rate_hz, tick_hz) in [(500.0, 1e9), (300.0, 1000.0), (7000.0, 1e9), (0.3, 7.0)] {
        let spec =
            BufferSpec::default().with_rate_hz(rate_hz).with_tick_hz(tick_hz).with_seconds(20.0 / rate_hz);
        let (mut writer, reader) = wrench_buffer(spec).unwrap();
        let times = push_by_clock(&mut DeviceClock::new(&spec), &mut writer, std::iter::repeat_n(None, 3000));
        for (n, ticks) in times.iter().enumerate() {
            assert!(
                (*ticks as f64 - n as f64 * tick_hz / rate_hz).abs() <= 0.5,
                "row {n} at {rate_hz} Hz: {ticks}"
            );
        }
        assert_eq!(reader.stats().missing, 0);
    }
}

#[test]
fn rows_without_time_go_on_and_begin_at_zero_in_every_epoch() {
    let (mut writer, _) = buffer(20, 3);
    let mut clock = DeviceClock::new(&BufferSpec::default().with_tick_hz(500.0));
    let times = push_by_clock(&mut clock, &mut writer, [None, Some(7), None, Some(3), None]);
    assert_eq!(times, [0, 7, 8, 3, 9], "a row out of order leaves the clock where it is");
    let lost = clock.ticks(None, &writer);
    assert_eq!((lost, clock.ticks(None, &writer)), (10, 11), "a row that is not pushed has had its instant");
    push(&mut writer, [30]);
    assert_eq!(clock.ticks(None, &writer), 31, "rows that others pushed count");
    writer.new_epoch();
    assert_eq!(push_by_clock(&mut clock, &mut writer, [None, None, Some(600), None]), [0, 1, 600, 601]);
}
