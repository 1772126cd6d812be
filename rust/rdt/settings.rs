//! What a receiver needs to know of its box.

use std::time::Duration;

use super::fault::Fault;
use super::request::Request;
use super::scale::Scale;
use super::variant::Variant;

/// The port that boxes listen on unless told otherwise.
pub const PORT: u16 = 49152;

/// Silence that is an alarm, however fast records come; slower streams get three periods.
const ALARM: Duration = Duration::from_millis(20);
const ALARM_PERIODS: f64 = 3.0;

/// A box, and how to talk to it.
#[derive(Clone, Debug)]
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
    /// Whether to ask for several records per datagram.
    pub buffered: bool,
    /// Whether to ask for the stream again after a second of silence. Off by default: two clients that both do so
    /// would take it from each other for ever.
    pub resume: bool,
}

impl Settings {
    /// Settings of a Net F/T at its usual rate of 500 Hz: real time, no limits, no resuming.
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
            resume: false,
        }
    }

    /// Refuses numbers that no box has; [`Receiver::start`](super::Receiver::start) does so too.
    pub fn check(&self) -> Result<(), Fault> {
        let limits = self
            .limits
            .iter()
            .map(|limit| ("limits", *limit))
            .find(|(_, limit)| limit.is_nan() || *limit <= 0.0);
        let rate = (!(self.rate_hz.is_finite() && self.rate_hz > 0.0)).then_some(("rate_hz", self.rate_hz));
        limits.or(rate).map_or(Ok(()), |(what, value)| Err(Fault::Setting { what, value }))
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
    pub(super) fn alarm(&self) -> Duration {
        Duration::try_from_secs_f64(ALARM_PERIODS / self.rate_hz).unwrap_or(Duration::MAX).max(ALARM)
    }
}
