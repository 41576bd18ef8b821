//! Round trips and malformed blocks.

use super::*;
use proptest::prelude::*;

fn round_trip(start: ChannelPoint, knots: &[Knot]) -> (Vec<Knot, 4096>, usize) {
    let mut sender = KnotPredictor::new(start);
    let mut receiver = sender;
    let mut decoded = Vec::new();
    let mut bytes = 0;
    let mut rest = knots;
    while !rest.is_empty() {
        let (block, count) = encode_block(&mut sender, rest);
        assert!(count > 0);
        bytes += block.len();
        let knots = decode_block(&mut receiver, &block).unwrap();
        assert_eq!(knots.len(), count);
        assert_eq!(sender, receiver);
        decoded.extend(knots);
        rest = &rest[count..];
    }
    (decoded, bytes)
}

fn circle(radius_mm: f64, knots: usize) -> Vec<Knot, 4096> {
    (0..knots)
        .map(|i| {
            let angle = i as f64 * 0.05;
            let natural = [
                radius_mm * angle.cos(),
                radius_mm * angle.sin(),
                0.2,
                0.0,
                0.0,
                angle,
                angle * radius_mm * 0.1,
            ];
            Knot {
                control: crate::units::to_units(&natural),
                duration_ticks: 12 + (i % 5) as u16,
            }
        })
        .collect()
}

#[test]
fn a_circle_takes_few_bytes_and_comes_back_exactly() {
    let knots = circle(20.0, 640);
    let (decoded, bytes) = round_trip(knots[0].control, &knots);
    assert_eq!(decoded, knots);
    // Unpacked it is 30 bytes a knot.
    assert!(bytes < 640 * 12, "{bytes} bytes");
}

#[test]
fn rest_costs_a_few_bits_a_knot() {
    let knot = Knot {
        control: [7; CHANNELS],
        duration_ticks: 100,
    };
    let knots = [knot; 64];
    let (decoded, bytes) = round_trip([7; CHANNELS], &knots);
    assert_eq!(decoded, knots);
    assert_eq!(bytes, 2 * 5);
}

proptest! {
    #[test]
    fn any_knots_come_back_exactly(
        start in any::<[i32; CHANNELS]>(),
        raw in prop::collection::vec((any::<[i32; CHANNELS]>(), 1u16..=SPAN_TICKS_MAX, 0u32..32), 1..100),
    ) {
        // Shifts make small and large steps alike.
        let knots: std::vec::Vec<Knot> = raw
            .iter()
            .map(|(control, duration_ticks, shift)| Knot {
                control: control.map(|value| value >> shift),
                duration_ticks: *duration_ticks,
            })
            .collect();
        let (decoded, _) = round_trip(start, &knots);
        prop_assert_eq!(decoded.as_slice(), knots.as_slice());
    }

    #[test]
    fn arbitrary_bytes_never_panic_and_leave_the_predictor_alone(
        bytes in prop::collection::vec(any::<u8>(), 0..BLOCK_BYTES_MAX),
    ) {
        let mut predictor = KnotPredictor::new([3; CHANNELS]);
        let before = predictor;
        match decode_block(&mut predictor, &bytes) {
            Ok(knots) => prop_assert!(knots.iter().all(|knot|
                (1..=SPAN_TICKS_MAX).contains(&knot.duration_ticks))),
            Err(_) => prop_assert_eq!(predictor, before),
        }
    }

    #[test]
    fn a_truncated_or_lengthened_block_is_refused(count in 1usize..40, cut in 1usize..20) {
        let knots = circle(5.0, count);
        let (block, _) = encode_block(&mut KnotPredictor::new([0; CHANNELS]), &knots);
        let mut receiver = KnotPredictor::new([0; CHANNELS]);
        let kept = block.len().saturating_sub(cut);
        prop_assert!(decode_block(&mut receiver, &block[..kept]).is_err());
        let mut longer = block.to_vec();
        longer.push(0);
        prop_assert_eq!(decode_block(&mut receiver, &longer), Err(BlockError::TrailingBits));
    }
}
