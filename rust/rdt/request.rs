//! Requests to the sensor box: eight bytes, big-endian, never acknowledged.

/// First two bytes of every request.
const HEADER: u16 = 0x1234;

/// What a box can be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// End the stream.
    Stop,
    /// Records without end, one per datagram.
    StartRealTime,
    /// Records without end, several per datagram.
    StartBuffered,
    /// Forget which thresholds were exceeded.
    ResetThresholdLatch,
    /// Make the present load the new zero, for every client of the box.
    Bias,
    /// The same for boxes of `OnRobot`, which want a number with it.
    BiasOnRobot,
    /// Milliseconds between records, for boxes of `OnRobot`.
    PeriodOnRobot {
        /// The period.
        period_ms: u32,
    },
}

impl Request {
    /// The datagram.
    ///
    /// ```
    /// use granular_id::rdt::Request;
    ///
    /// assert_eq!(Request::StartRealTime.bytes(), [0x12, 0x34, 0, 2, 0, 0, 0, 0]);
    /// ```
    #[must_use]
    pub fn bytes(self) -> [u8; 8] {
        let (command, number): (u16, u32) = match self {
            Self::Stop => (0x0000, 0),
            Self::StartRealTime => (0x0002, 0),
            Self::StartBuffered => (0x0003, 0),
            Self::ResetThresholdLatch => (0x0041, 0),
            Self::Bias => (0x0042, 0),
            Self::BiasOnRobot => (0x0042, 255),
            Self::PeriodOnRobot { period_ms } => (0x0082, period_ms),
        };
        let mut bytes = [0; 8];
        bytes[..2].copy_from_slice(&HEADER.to_be_bytes());
        bytes[2..4].copy_from_slice(&command.to_be_bytes());
        bytes[4..].copy_from_slice(&number.to_be_bytes());
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_these_bytes() {
        assert_eq!(Request::Stop.bytes(), *b"\x12\x34\x00\x00\x00\x00\x00\x00");
        assert_eq!(Request::StartRealTime.bytes(), *b"\x12\x34\x00\x02\x00\x00\x00\x00");
        assert_eq!(Request::StartBuffered.bytes(), *b"\x12\x34\x00\x03\x00\x00\x00\x00");
        assert_eq!(Request::ResetThresholdLatch.bytes(), *b"\x12\x34\x00\x41\x00\x00\x00\x00");
        assert_eq!(Request::Bias.bytes(), *b"\x12\x34\x00\x42\x00\x00\x00\x00");
        assert_eq!(Request::BiasOnRobot.bytes(), *b"\x12\x34\x00\x42\x00\x00\x00\xff");
        let period = Request::PeriodOnRobot { period_ms: 0x0102 };
        assert_eq!(period.bytes(), *b"\x12\x34\x00\x82\x00\x00\x01\x02");
    }
}
