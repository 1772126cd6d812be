//! Host time from device time: clocks that drift, rows that are late, steps and restarts.

use granular_id::buffer::{wrench_buffer, BufferSpec, Reader, Row, Writer};

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
        self.writer.push(&Row { ticks: ORIGIN_TICKS + n * PERIOD_NS, host_ns, wrench: [0.0; 6], flags: 0 });
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
        device.writer.push(&Row { ticks, host_ns, wrench: [0.0; 6], flags: 0 });
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
    let row = Row { ticks: 0, host_ns: 77_000_000_000, wrench: [0.0; 6], flags: 0 };
    device.writer.push(&row);
    assert_eq!(device.reader.lag_ns(row.host_ns + 5), Some(5.0));
    assert_eq!(device.reader.host_ns_at(PERIOD_NS), Some((row.host_ns + PERIOD_NS) as f64));
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
