//! Wrenches from an F/T sensor that speaks RDT over UDP.
//!
//! ATI's Net F/T and Ethernet Axia stream records of 36 bytes to the client whose request came last; boxes of `OnRobot` use the same
//! framing. A packet is read in `packet`, where [`Variant::judge`] judges its status word; [`Decoder`] judges its numbers
//! (next, late, again, of another stream) and limits, and gives rows, without a socket; [`Receiver`] is the thread that
//! feeds it and writes to a [`buffer`](crate::buffer).
//!
//! Source: ATI Industrial Automation, manuals 9620-05-NET FT and 9610-05-Ethernet Axia, chapters on UDP and status codes.

mod decoder;
mod packet;
mod receiver;

use std::time::Duration;

pub use decoder::{Decoded, Decoder};
pub use packet::{
    records, Record, Request, Scale, Variant, COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_METRE, MAX_RECORDS,
    RECORD_BYTES,
};
pub use receiver::{Receiver, State};

use crate::buffer::counters;
use crate::error::short_number;
use crate::specs::setters;

/// The port that boxes listen on by default.
pub const PORT: u16 = 49152;

/// Silence that is an alarm, however fast records come; slower streams get three periods.
const ALARM: Duration = Duration::from_millis(20);
const ALARM_PERIODS: f64 = 3.0;

/// Silence that is an alarm, however slowly records come.
const LONGEST_ALARM: Duration = Duration::from_secs(60);

/// A box, and how to talk to it.
///
/// ```
/// use granular_id::rdt::{Scale, Settings, Variant};
///
/// let settings = Settings::new("192.168.1.1", Scale::new(1e6, 1e6)?).with_variant(Variant::Axia).with_rate_hz(1000.0);
/// assert_eq!((settings.port, settings.rate_hz), (49152, 1000.0));
/// # Ok::<(), granular_id::rdt::RdtError>(())
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Settings {
    /// Name or address of the box.
    pub host: String,
    /// Its UDP port.
    pub port: u16,
    /// What kind of box it is.
    pub variant: Variant,
    /// Counts per newton and newton metre.
    pub scale: Scale,
    /// Records beyond this are rejected, N and N m.
    pub limits: [f64; 6],
    /// Records per second that the box is set to send.
    pub rate_hz: f64,
    /// True to request several records per datagram.
    pub buffered: bool,
}

setters! {
    Settings:
    with_port port u16,
    with_variant variant Variant,
    with_limits limits [f64; 6],
    with_rate_hz rate_hz f64,
    with_buffered buffered bool,
}

impl Settings {
    /// Settings of a Net F/T at its usual rate of 500 Hz: real time, no limits.
    #[must_use]
    pub fn new(host: &str, scale: Scale) -> Self {
        Self {
            host: host.to_owned(),
            port: PORT,
            variant: Variant::NetFt,
            scale,
            limits: [f64::INFINITY; 6],
            rate_hz: 500.0,
            buffered: false,
        }
    }

    /// Refuses numbers that no box has; [`Receiver::start`] does so too.
    pub fn check(&self) -> Result<(), RdtError> {
        if let Some(limit) = self.limits.into_iter().find(|limit| limit.is_nan() || *limit <= 0.0) {
            return Err(RdtError::Setting { what: "limits", wanted: "positive".to_owned(), value: limit });
        }
        if !(self.rate_hz.is_finite() && self.rate_hz > 0.0) {
            return Err(RdtError::Setting {
                what: "rate_hz",
                wanted: "positive and finite".to_owned(),
                value: self.rate_hz,
            });
        }
        Ok(())
    }

    /// Requests that start the stream, in order.
    #[must_use]
    pub fn start_requests(&self) -> Vec<Request> {
        let start = if self.buffered { Request::StartBuffered } else { Request::StartRealTime };
        match self.variant {
            // Whole milliseconds, 4 ms at least on older firmware; the cast saturates.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            Variant::OnRobot => {
                vec![
                    Request::PeriodOnRobot { period_ms: (1000.0 / self.rate_hz).round().max(1.0) as u32 },
                    start,
                ]
            }
            Variant::NetFt | Variant::Axia => vec![start],
        }
    }

    /// The request that makes the present load the new zero.
    #[must_use]
    pub fn bias_request(&self) -> Request {
        match self.variant {
            Variant::OnRobot => Request::BiasOnRobot,
            Variant::NetFt | Variant::Axia => Request::Bias,
        }
    }

    /// Silence that counts as a stall.
    fn alarm(&self) -> Duration {
        Duration::try_from_secs_f64(ALARM_PERIODS / self.rate_hz)
            .unwrap_or(LONGEST_ALARM)
            .clamp(ALARM, LONGEST_ALARM)
    }
}

counters! {
    /// Numbers of a stream since its start. Every datagram and every record is counted under exactly one reason:
    /// `records = rows + duplicates + stale + implausible + out_of_range`, but for one record that may wait for the next.
    Counts, Cells:
    /// Datagrams that arrived.
    datagrams,
    /// Datagrams of another length than 1 to 40 records.
    malformed,
    /// Records in the datagrams that were well-formed.
    records,
    /// Records handed on.
    rows,
    /// Records missing from the numbering of the stream; one that arrives late is taken off again.
    lost,
    /// Records that came after one with a higher number; they are among the rows.
    reordered,
    /// Records that came again.
    duplicates,
    /// Records of a sample that an earlier record brought, under a new number.
    stale,
    /// Records that continue nothing, and that no later record continues.
    implausible,
    /// Records with a force or torque beyond all sense for the sensor.
    out_of_range,
    /// Times that the numbering began anew.
    restarts,
    /// Rows whose status word is an error.
    bad_status,
    /// Rows with a status of saturation, or a count at the end of its 32 bits.
    saturated,
    /// Rows whose status word is a mere warning.
    warnings,
}

/// Why there is no stream.
///
/// Not a variant of [`Error`](crate::Error), which is about arguments: most of these are about the world.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RdtError {
    /// A scale or another setting that no box has.
    #[error("{what} must be {wanted}, got {}", short_number(*.value))]
    Setting {
        /// Which one.
        what: &'static str,
        /// The range.
        wanted: String,
        /// The value given.
        value: f64,
    },
    /// A host name that leads nowhere.
    #[error("{host} has no address: {reason}")]
    Host {
        /// The name.
        host: String,
        /// The system's words.
        reason: String,
    },
    /// A call of the operating system that failed.
    #[error("{what} {host}:{port} failed: {reason}")]
    System {
        /// What was tried.
        what: &'static str,
        /// The host.
        host: String,
        /// The port.
        port: u16,
        /// The system's words.
        reason: String,
    },
    /// Nothing listens at the address.
    #[error("nothing listens at {host}:{port} (UDP): wrong address, or the box is off or has RDT disabled")]
    Refused {
        /// The host.
        host: String,
        /// The port.
        port: u16,
    },
    /// No stream came.
    #[error(
        "no stream from {host}:{port} within {:.1} s of {requests} requests ({datagrams} datagrams made none): another \
         client may own the stream, or a firewall stands between", .waited.as_secs_f64()
    )]
    Silent {
        /// The host.
        host: String,
        /// The port.
        port: u16,
        /// How long was waited.
        waited: Duration,
        /// Requests for the stream.
        requests: u32,
        /// Datagrams that came, and were no two records that continue one another.
        datagrams: u64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(rate_hz: f64) -> Settings {
        Settings { rate_hz, ..Settings::new("box", Scale::new(1e6, 1e6).unwrap()) }
    }

    #[test]
    fn an_alarm_is_a_time_that_can_be_waited_for() {
        for (rate_hz, alarm) in [
            (1e300, ALARM),
            (500.0, ALARM),
            (10.0, Duration::from_millis(300)),
            (1e-3, LONGEST_ALARM),
            (1e-300, LONGEST_ALARM),
        ] {
            assert_eq!(settings(rate_hz).alarm(), alarm, "{rate_hz} Hz");
        }
    }

    #[test]
    fn numbers_that_no_box_has_are_refused() {
        for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = settings(rate_hz).check().unwrap_err().to_string();
            assert_eq!(error, format!("rate_hz must be positive and finite, got {rate_hz}"));
        }
        for limit in [0.0, -1.0, f64::NAN] {
            let limits = [1.0, 1.0, 1.0, limit, 1.0, f64::INFINITY];
            let error = Settings { limits, ..settings(500.0) }.check().unwrap_err().to_string();
            assert_eq!(error, format!("limits must be positive, got {limit}"));
        }
        assert_eq!(Settings { limits: [f64::INFINITY; 6], ..settings(500.0) }.check(), Ok(()));
    }
}
