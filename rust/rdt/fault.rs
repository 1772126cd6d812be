//! What can go wrong with a sensor box before its first record.

use std::time::Duration;

use crate::error::brief;

/// Why there is no stream.
///
/// Not a variant of [`Error`](crate::Error), which is about arguments: most of these are about the world.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// A scale that no sensor has.
    #[error("{what} must be from {least} to {most:e}, got {}", brief(*.value))]
    Scale {
        /// Which one.
        what: &'static str,
        /// The value given.
        value: f64,
        /// The least that is believed.
        least: f64,
        /// The most.
        most: f64,
    },
    /// A number among the settings outside its range.
    #[error("{what} must be {wanted}, got {}", brief(*.value))]
    Setting {
        /// Which one.
        what: &'static str,
        /// The range.
        wanted: &'static str,
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
    /// Nobody listens at the address.
    #[error("nobody listens at {host}:{port} (UDP): wrong address, or the box is off or has RDT disabled")]
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
        /// How often the stream was asked for.
        requests: u32,
        /// Datagrams that came, and were no two records that continue one another.
        datagrams: u64,
    },
}
