//! The sentence about the last error of each thread, in memory that is there from the start: a push that fails allocates
//! nothing.

use std::cell::RefCell;
use std::fmt::{Arguments, Result, Write};

use crate::gid_status;

/// Bytes of the longest sentence: what is longer is cut.
const MOST: usize = 1024;

struct Sentence {
    bytes: [u8; MOST],
    len: usize,
}

/// The beginning of a text, at most `room` bytes of whole characters.
fn cut(text: &str, room: usize) -> &str {
    let mut end = room.min(text.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}

thread_local! {
    static LAST: RefCell<Sentence> = const { RefCell::new(Sentence { bytes: [0; MOST], len: 0 }) };
}

impl Write for Sentence {
    fn write_str(&mut self, text: &str) -> Result {
        let text = cut(text, MOST - self.len);
        self.bytes[self.len..][..text.len()].copy_from_slice(text.as_bytes());
        self.len += text.len();
        Ok(())
    }
}

/// Stores a sentence for `gid_last_error`, and gives the status back.
pub(crate) fn failed(status: gid_status, sentence: Arguments<'_>) -> gid_status {
    LAST.with_borrow_mut(|last| {
        last.len = 0;
        // Writing never fails: what is too long is cut.
        let _ = last.write_fmt(sentence);
    });
    status
}

/// Copies the last sentence to `n` bytes, the last of which becomes zero; returns its whole length.
pub(crate) unsafe fn copy(to: *mut u8, n: usize) -> usize {
    LAST.with_borrow(|last| {
        if let Some(room) = n.checked_sub(1).filter(|_| !to.is_null()) {
            let text = cut(str::from_utf8(&last.bytes[..last.len]).unwrap_or_default(), room);
            // SAFETY: the caller promises `n` bytes.
            unsafe {
                to.copy_from_nonoverlapping(text.as_ptr(), text.len());
                to.add(text.len()).write(0);
            }
        }
        last.len
    })
}
