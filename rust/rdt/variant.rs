//! The kinds of box that speak this protocol, and what their status words mean.

use crate::wrench::{BAD_STATUS, SATURATED};

/// "Any error": set together with the bit of its cause.
const ERROR: u32 = 1 << 31;

/// A threshold was exceeded since the latch was reset: set by the user, no fault of the sensor.
const THRESHOLD: u32 = 1 << 16;

/// Net F/T: saturation of a gauge, or an error of the converter.
const NET_FT_SATURATED: u32 = 1 << 17;

/// Axia: gauge out of range, force or torque out of range.
const AXIA_SATURATED: u32 = 1 << 27 | 1 << 30;

/// Axia: what its manual calls an error (temperature, supply, broken gauge, other, calibration) and the two above.
const AXIA_ERRORS: u32 = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 5 | 1 << 7 | 1 << 29 | AXIA_SATURATED;

/// A kind of sensor box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// ATI Net F/T.
    NetFt,
    /// ATI Ethernet Axia.
    Axia,
    /// `OnRobot` (`OptoForce`) HEX with its box: the same framing, other requests.
    OnRobot,
}

impl Variant {
    /// Flags of a sample with this status word, as in [`wrench`](crate::wrench), and whether the word is a mere
    /// warning.
    ///
    /// ```
    /// use granular_id::{rdt::Variant, wrench};
    ///
    /// assert_eq!(Variant::NetFt.judge(0), (0, false));
    /// assert_eq!(Variant::NetFt.judge(0x8001_0000), (0, true));
    /// assert_eq!(Variant::NetFt.judge(0x8002_0000), (wrench::BAD_STATUS | wrench::SATURATED, false));
    /// ```
    #[must_use]
    pub fn judge(self, status: u32) -> (u8, bool) {
        // "Any error" with nothing but a threshold as its cause is none.
        let causes = status & !(ERROR | THRESHOLD);
        let error = status & ERROR != 0 && (causes != 0 || status & THRESHOLD == 0);
        let (error, saturated) = match self {
            Self::NetFt => (error, status & NET_FT_SATURATED != 0),
            Self::Axia => (error || status & AXIA_ERRORS != 0, status & AXIA_SATURATED != 0),
            // The meaning of its bits depends on the firmware; 0 is healthy in all of them.
            Self::OnRobot => (status != 0, false),
        };
        let mut flags = 0;
        if error {
            flags |= BAD_STATUS;
        }
        if saturated {
            flags |= SATURATED;
        }
        (flags, status != 0 && flags == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn net_ft() {
        let judge = |status| Variant::NetFt.judge(status);
        assert_eq!(judge(0), (0, false));
        assert_eq!(judge(ERROR), (BAD_STATUS, false));
        assert_eq!(judge(THRESHOLD), (0, true));
        assert_eq!(judge(ERROR | THRESHOLD), (0, true));
        assert_eq!(judge(ERROR | THRESHOLD | 4), (BAD_STATUS, false));
        assert_eq!(judge(NET_FT_SATURATED), (SATURATED, false));
        assert_eq!(judge(ERROR | NET_FT_SATURATED), (BAD_STATUS | SATURATED, false));
        // Axia's bit for a force out of range is not the Net F/T's
        assert_eq!(judge(1 << 30), (0, true));
    }

    #[test]
    fn axia() {
        let judge = |status| Variant::Axia.judge(status);
        assert_eq!(judge(0), (0, false));
        for bit in [0, 1, 2, 5, 29] {
            assert_eq!(judge(ERROR | 1 << bit), (BAD_STATUS, false), "bit {bit}");
            assert_eq!(judge(1 << bit), (BAD_STATUS, false), "bit {bit}");
        }
        assert_eq!(judge(0x8000_0008), (BAD_STATUS, false));
        assert_eq!(judge(0x8800_0000), (BAD_STATUS | SATURATED, false));
        assert_eq!(judge(0xc000_0000), (BAD_STATUS | SATURATED, false));
        assert_eq!(judge(0x0001_0000), (0, true));
        assert_eq!(judge(0x1000_0000), (0, true));
        // the Net F/T's bit for saturation is not Axia's
        assert_eq!(judge(NET_FT_SATURATED), (0, true));
    }

    #[test]
    fn on_robot_knows_healthy_and_not() {
        assert_eq!(Variant::OnRobot.judge(0), (0, false));
        assert_eq!(Variant::OnRobot.judge(1), (BAD_STATUS, false));
        assert_eq!(Variant::OnRobot.judge(u32::MAX), (BAD_STATUS, false));
    }
}
