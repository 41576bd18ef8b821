//! SPI in software on pins: mode 3, highest bit first, one chip select for each driver.
//!
//! In: levels of four wires. Out: the datagrams that a driver and the board exchange. The clock idles high; bits change
//! after its falling edge and are taken at its rising edge (TMC5160 rev. 1.17 and TMC2240 rev. 3, chapter 4 each, up to
//! 4 MHz). The board sets the pace, so that an interrupt at any place does no harm. Not covered: chips in a chain.

/// Bytes of a datagram, in both directions at once.
pub const DATAGRAM_BYTES: usize = 5;

/// The wires of a bus.
pub trait BusWires {
    /// Selects the driver of a motor (low), or lets it go; false if the board has no such wire.
    fn select(&mut self, motor: usize, selected: bool) -> bool;
    /// The clock's level.
    fn clock(&mut self, high: bool);
    /// The level to the drivers.
    fn send(&mut self, high: bool);
    /// The level from them.
    fn receive(&mut self) -> bool;
    /// Half a period of the clock.
    fn wait(&mut self);
}

/// Exchanges a datagram with the driver of a motor; false if the board has no bus to it.
pub fn transfer(
    wires: &mut impl BusWires,
    motor: usize,
    request: &[u8; DATAGRAM_BYTES],
    reply: &mut [u8; DATAGRAM_BYTES],
) -> bool {
    if !wires.select(motor, true) {
        return false;
    }
    wires.wait();
    for (sent, heard) in request.iter().zip(reply) {
        for bit in (0..u8::BITS).rev() {
            wires.clock(false);
            wires.send(sent >> bit & 1 == 1);
            wires.wait();
            *heard = *heard << 1 | u8::from(wires.receive());
            wires.clock(true);
            wires.wait();
        }
    }
    wires.select(motor, false);
    wires.wait();
    true
}
