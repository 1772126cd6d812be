//! The socket to a box, and the first exchange over it.

use std::io::{Error, ErrorKind};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::{Duration, Instant};

use socket2::{Domain, Protocol, Socket, Type};

use super::decoder::Decoder;
use super::fault::Fault;
use super::record::ROOM;
use super::settings::Settings;
use super::work;
use crate::buffer::{host_ns, Writer};

/// Asked of the system for datagrams that wait: half a minute at 500 Hz, five seconds at 7000 Hz.
const RECEIVE_BUFFER: usize = 4 << 20;

/// Requests for the stream, as any of them may be lost, ...
const ATTEMPTS: u32 = 10;

/// ... and how long each may take.
const PATIENCE: Duration = Duration::from_millis(100);

/// A failed call as a fault.
pub(super) fn system(what: &'static str, settings: &Settings, error: &Error) -> Fault {
    let Settings { host, port, .. } = settings;
    if error.kind() == ErrorKind::ConnectionRefused {
        return Fault::Refused { host: host.clone(), port: *port };
    }
    Fault::System { what, host: host.clone(), port: *port, reason: error.to_string() }
}

/// A thread that ended before it began.
pub(super) fn gone(settings: &Settings) -> Fault {
    system("starting a thread for", settings, &Error::other("it ended at once"))
}

/// A socket that talks to the box only: the kernel drops what others send. Also the bytes it may hold.
pub(super) fn connected(settings: &Settings) -> Result<(UdpSocket, usize), Fault> {
    let address = resolved(settings)?;
    let open = || {
        let socket = Socket::new(Domain::for_address(address), Type::DGRAM, Some(Protocol::UDP))?;
        socket.set_recv_buffer_size(RECEIVE_BUFFER)?;
        socket.connect(&address.into())?;
        // The system may grant less; it is reported, as it decides how long the thread may be kept waiting.
        let granted = socket.recv_buffer_size()?;
        Ok((UdpSocket::from(socket), granted))
    };
    open().map_err(|error| system("opening a socket to", settings, &error))
}

fn resolved(settings: &Settings) -> Result<SocketAddr, Fault> {
    let host = settings.host.as_str();
    let fault = |reason: String| Fault::Host { host: host.to_owned(), reason };
    let found = (host, settings.port).to_socket_addrs().map_err(|error| fault(error.to_string()))?;
    // Boxes speak IPv4: an address of that kind first, where a name has both.
    let mut addresses: Vec<SocketAddr> = found.collect();
    addresses.sort_by_key(SocketAddr::is_ipv6);
    addresses.first().copied().ok_or_else(|| fault("the name is known, but has none".to_owned()))
}

/// Asks for the stream until two records confirm each other and the first rows are in the buffer. Returns the number of
/// requests.
pub(super) fn first_rows(
    socket: &UdpSocket,
    settings: &Settings,
    decoder: &mut Decoder,
    writer: &mut Writer,
) -> Result<u32, Fault> {
    let started = Instant::now();
    let mut refused = false;
    let mut bytes = [0; ROOM];
    // A box sends its first records one and two periods after the request.
    let patience = PATIENCE.max(settings.alarm());
    for attempt in 1..=ATTEMPTS {
        for request in settings.start_requests() {
            match socket.send(&request.bytes()) {
                // An answer to the request before: the box may be starting.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => refused = true,
                sent => drop(sent.map_err(|error| system("sending to", settings, &error))?),
            }
        }
        let until = Instant::now() + patience;
        while let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
            let received = socket.set_read_timeout(Some(left)).and_then(|()| socket.recv(&mut bytes));
            match received {
                Ok(length) => {
                    work::write(decoder, bytes.get(..length).unwrap_or_default(), host_ns(), writer);
                    if decoder.counts().rows > 0 {
                        return Ok(attempt);
                    }
                }
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
                    ErrorKind::ConnectionRefused => {
                        refused = true;
                        std::thread::sleep(left);
                    }
                    _ => return Err(system("receiving from", settings, &error)),
                },
            }
        }
    }
    work::stop(socket, &mut bytes);
    let (host, port) = (settings.host.clone(), settings.port);
    let datagrams = decoder.counts().datagrams;
    Err(if refused && datagrams == 0 {
        Fault::Refused { host, port }
    } else {
        Fault::Silent { host, port, waited: started.elapsed(), requests: ATTEMPTS, datagrams }
    })
}
