//! Features while rows arrive: one thread reads a sensor into a buffer, another takes rows out and extracts.
//!
//! ```text
//! cargo run --example stream
//! ```
//!
//! The sensor is SIMULATED, and loses ten rows on the way. Put your own in place of `simulated_sensor`: the buffer wants the
//! clock of the device, the time of arrival and six values a row. With a trained model, `stream::StreamingIdentifier` takes
//! rows in the same way, and answers with a material.

use std::thread;
use std::time::Duration;

use granular_id::buffer::{host_ns, wrench_buffer, BufferSpec, BufferedRow, Row, Writer};
use granular_id::features::Initial;
use granular_id::stream::{StreamingExtractor, Windows};
use granular_id::{Extractor, FeatureSpec, Result};

const RATE_HZ: f64 = 500.0;
const N_ROWS: u64 = 2400;

fn main() -> Result<()> {
    // The clock of this sensor counts rows.
    let (writer, mut reader) =
        wrench_buffer(BufferSpec::default().with_rate_hz(RATE_HZ).with_tick_hz(RATE_HZ))?;
    let sensor = thread::spawn(move || simulated_sensor(writer));

    // Histograms of what lies above 23 Hz, over windows of 0.8 s, one every 0.4 s. The paper's filter starts at rest, and
    // the offset of a sensor would ring in the first window.
    let spec = FeatureSpec::default().with_rate_hz(RATE_HZ).with_raw(false).with_initial(Initial::Steady);
    let windows = Windows::new(400, 6).with_hop(Some(200));
    let mut stream = StreamingExtractor::new(&Extractor::new(spec)?, windows)?;
    let mut features = vec![0.0; stream.n_features()];

    let mut rows = [BufferedRow::EMPTY; 50];
    let mut lost = 0;
    loop {
        let ended = sensor.is_finished();
        let taken = reader.read(&mut rows)?;
        // Overwritten before they were read: a reader that is too slow for the buffer.
        lost += taken.missed;
        for BufferedRow { row, missing_before, .. } in &rows[..taken.n_rows] {
            lost += u64::from(*missing_before);
            if lost > 0 {
                println!("{lost} rows are missing before row {}: a window begins anew", row.ticks);
                stream.reset();
                lost = 0;
            }
            stream.push(&row.wrench)?;
            if stream.is_complete() {
                stream.features_into(&mut features)?;
                let percent = rough_percent(&features);
                println!("row {:4}: fx is rough in {percent:4.1} % of the samples", row.ticks);
                stream.next_window()?;
            }
        }
        if taken.n_rows == 0 {
            if ended {
                return Ok(());
            }
            thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Share of a window in which fx above 23 Hz is beyond 0.3 N: outside of bins 40 to 59 of its 100 from -1.5 to 1.5 N.
fn rough_percent(features: &[f64]) -> f64 {
    100.0 - features[40..60].iter().sum::<f64>() / 400.0 * 100.0
}

/// Writes rows as a sensor would send them: a smooth material first, then a rough one.
fn simulated_sensor(mut writer: Writer) {
    let mut noise = 1_u32;
    for ticks in (0..N_ROWS).filter(|ticks| !(1000..1010).contains(ticks)) {
        // A linear congruential generator: from -1 to 1.
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let roughness_n = if ticks < N_ROWS / 2 { 0.1 } else { 0.6 };
        let fx = 5.0 + roughness_n * (f64::from(noise) / f64::from(u32::MAX) * 2.0 - 1.0);
        writer.push(&Row { ticks, host_ns: host_ns(), wrench: [fx, 0.0, -2.0, 0.0, 0.3, 0.0], flags: 0 });
        thread::sleep(Duration::from_secs_f64(1.0 / RATE_HZ));
    }
}
