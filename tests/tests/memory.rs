//! Goal: what planning keeps of a long move stays bounded a servo tick, so that a plate of 240 mm has
//! room. Method: an allocator that counts, over the laying of the segments of a long spiral. A test of its own
//! file, since all of a program shares the allocator.

use headway::plan::motion::segments::lay_segments;
use headway::settings::Settings;
use headway_tests::routes::{gear, route_of};
use headway_tests::segment_oracle::duration_s;
use peak_alloc::PeakAlloc;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

/// Bytes a tick; 205 are reached. The samples of the path, 216 bytes each, kept to the end and the ticks'
/// channels and tangents, 112 bytes, kept as well are each more than the room that is left.
const BYTES_PER_TICK_MAX: f64 = 250.0;

#[test]
fn a_long_stretch_takes_few_bytes_a_tick() {
    let settings = Settings::default();
    let route = route_of(gear(3000.0));
    HEAP.reset_peak_usage();
    let before = HEAP.current_usage();
    let (stream, _) = lay_segments(&route, &settings).expect("segments");
    let bytes = HEAP.peak_usage() - before;
    let ticks = duration_s(&stream) * f64::from(settings.machine.servo_hz);
    let per_tick = bytes as f64 / ticks;
    println!("{per_tick:.0} bytes a tick, {ticks:.0} ticks");
    assert!(ticks > 100_000.0, "{ticks}");
    assert!(per_tick < BYTES_PER_TICK_MAX, "{per_tick}");
}
