//! What the receiver thread does until it is told to stop.

use std::io::{Error, ErrorKind, Result};
use std::net::UdpSocket;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::decoder::{Decoded, Decoder};
use super::record::ROOM;
use super::request::Request;
use super::settings::Settings;
use super::shared::{Shared, State};
use crate::buffer::{host_ns, Writer};

/// The thread looks this often whether it is to stop.
const WAKE: Duration = Duration::from_millis(20);

/// Without a datagram for so long the stream counts as ended.
const SILENCE: Duration = Duration::from_secs(1);

/// After an error of the operating system that may be lasting.
const PAUSE: Duration = Duration::from_millis(10);

/// A stop request may be lost like any datagram: it is repeated until nothing comes any more, so often at most.
const STOPS: usize = 10;

/// Datagrams still taken once the thread is to stop: more than 4 MB hold.
const LAST_DATAGRAMS: usize = 1 << 17;

/// Everything that the thread owns.
pub(super) struct Work {
    socket: UdpSocket,
    decoder: Decoder,
    settings: Settings,
    shared: Arc<Shared>,
    writer: Writer,
    newest: Instant,
    stalled: bool,
    asked: Instant,
}

impl Work {
    pub(super) fn new(
        socket: UdpSocket,
        decoder: Decoder,
        settings: Settings,
        shared: Arc<Shared>,
        writer: Writer,
    ) -> Self {
        let now = Instant::now();
        Self { socket, decoder, settings, shared, writer, newest: now, stalled: false, asked: now }
    }

    pub(super) fn into_writer(self) -> Writer {
        self.writer
    }

    pub(super) fn run(mut self) -> Writer {
        let mut bytes = [0; ROOM];
        let ready =
            self.socket.set_nonblocking(false).and_then(|()| self.socket.set_read_timeout(Some(WAKE)));
        if ready.is_err() {
            self.shared.set_state(State::Broken);
            return self.writer;
        }
        while !self.shared.stop.load(Relaxed) {
            let received = self.socket.recv(&mut bytes);
            self.received(received, &bytes);
        }
        self.end(&mut bytes);
        self.writer
    }

    fn received(&mut self, received: Result<usize>, bytes: &[u8]) {
        match received {
            Ok(length) => self.take(bytes.get(..length).unwrap_or_default()),
            Err(error) => match error.kind() {
                ErrorKind::Interrupted => {}
                ErrorKind::WouldBlock | ErrorKind::TimedOut => self.silence(),
                _ => self.error(&error),
            },
        }
    }

    fn take(&mut self, datagram: &[u8]) {
        let (now, now_ns) = (Instant::now(), host_ns());
        if !self.stalled && now - self.newest > self.settings.alarm() {
            self.shared.stalls.fetch_add(1, Relaxed);
        }
        self.newest = now;
        self.stalled = false;
        let Self { decoder, writer, shared, .. } = self;
        write(decoder, datagram, now_ns, writer);
        shared.newest_host_ns.store(now_ns, Relaxed);
        shared.publish(decoder.counts());
        shared.set_state(State::Streaming);
    }

    fn silence(&mut self) {
        let silent = self.newest.elapsed();
        if !self.stalled && silent > self.settings.alarm() {
            self.stalled = true;
            self.shared.stalls.fetch_add(1, Relaxed);
        }
        if silent > SILENCE.max(self.settings.alarm()) {
            self.shared.set_state(State::Silent);
            if self.settings.resume && self.asked.elapsed() > SILENCE {
                self.asked = Instant::now();
                self.ask();
            }
        }
    }

    fn ask(&self) {
        for request in self.settings.start_requests() {
            match self.socket.send(&request.bytes()) {
                Ok(_) => self.shared.requests.fetch_add(1, Relaxed),
                Err(_) => self.shared.socket_errors.fetch_add(1, Relaxed),
            };
        }
    }

    fn error(&mut self, error: &Error) {
        self.shared.socket_errors.fetch_add(1, Relaxed);
        // "Refused" is an answer to an earlier request: the box is not up, and may come up again.
        if error.kind() != ErrorKind::ConnectionRefused {
            self.shared.set_state(State::Broken);
        }
        std::thread::sleep(PAUSE);
        self.silence();
    }

    /// Takes what is there, then asks for the end until nothing comes any more.
    fn end(&mut self, bytes: &mut [u8; ROOM]) {
        if self.socket.set_nonblocking(true).is_ok() {
            for _ in 0..LAST_DATAGRAMS {
                match self.socket.recv(bytes) {
                    Ok(length) => self.take(bytes.get(..length).unwrap_or_default()),
                    Err(_) => break,
                }
            }
        }
        self.decoder.finish();
        self.writer.flush();
        self.shared.publish(self.decoder.counts());
        stop(&self.socket, bytes);
        self.shared.set_state(State::Stopped);
    }
}

/// Writes what a datagram makes certain into the buffer.
pub(super) fn write(decoder: &mut Decoder, datagram: &[u8], now_ns: u64, writer: &mut Writer) {
    decoder.datagram(datagram, now_ns, &mut |decoded| match decoded {
        Decoded::Row(row) => {
            // What the buffer does with it, it counts itself. Restarts are told: a swapped datagram of forty records is
            // late, and no restart.
            writer.push_in_epoch(&row);
        }
        Decoded::NewEpoch => writer.new_epoch(),
    });
}

/// Asks for the end of a stream until nothing comes any more.
pub(super) fn stop(socket: &UdpSocket, bytes: &mut [u8; ROOM]) {
    let quiet = socket.set_nonblocking(false).and_then(|()| socket.set_read_timeout(Some(WAKE)));
    for _ in 0..STOPS {
        // Nothing can be done where this fails; a box that is gone needs no request.
        let sent = socket.send(&Request::Stop.bytes());
        let until = Instant::now() + WAKE;
        if quiet.is_err() || sent.is_err() || !comes_after(socket, bytes, until) {
            return;
        }
    }
}

/// Reads until nothing comes for a while, or the time has passed. Returns whether something came after it.
fn comes_after(socket: &UdpSocket, bytes: &mut [u8; ROOM], until: Instant) -> bool {
    while socket.recv(bytes).is_ok() {
        if Instant::now() > until {
            return true;
        }
    }
    false
}
