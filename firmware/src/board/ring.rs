//! A ring buffer for bytes from an interrupt to the main loop: one writer, one reader, no waiting.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// A ring of `BYTES`: a power of two, so that the counters may wrap.
#[derive(Debug)]
pub struct ByteRing<const BYTES: usize> {
    bytes: [AtomicU8; BYTES],
    written: AtomicUsize,
    read: AtomicUsize,
}

impl<const BYTES: usize> ByteRing<BYTES> {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            bytes: [const { AtomicU8::new(0) }; BYTES],
            written: AtomicUsize::new(0),
            read: AtomicUsize::new(0),
        }
    }

    /// A byte has arrived; by one context only. With the ring full it is lost: the host sends the frame
    /// again.
    pub fn push(&self, byte: u8) {
        let written = self.written.load(Ordering::Relaxed);
        if written.wrapping_sub(self.read.load(Ordering::Acquire)) < BYTES
            && let Some(slot) = self.bytes.get(written % BYTES)
        {
            slot.store(byte, Ordering::Relaxed);
            self.written
                .store(written.wrapping_add(1), Ordering::Release);
        }
    }

    /// The oldest byte; by one context only.
    pub fn pop(&self) -> Option<u8> {
        let read = self.read.load(Ordering::Relaxed);
        if read == self.written.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes.get(read % BYTES)?.load(Ordering::Relaxed);
        self.read.store(read.wrapping_add(1), Ordering::Release);
        Some(byte)
    }

    /// True if nothing waits.
    pub fn is_empty(&self) -> bool {
        self.read.load(Ordering::Relaxed) == self.written.load(Ordering::Acquire)
    }
}

impl<const BYTES: usize> Default for ByteRing<BYTES> {
    fn default() -> Self {
        Self::new()
    }
}
