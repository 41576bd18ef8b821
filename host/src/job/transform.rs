//! Position of the part on the machine: input coordinates -> machine coordinates.
//!
//! A translation, in mm, chosen once by [`PartTransform::choose`], kept in the job's header and
//! applied before kinematics. Everything that the user sees is in input coordinates. Not covered:
//! rotation; the user rotates the drawing.

use crate::geometry::polygon::Box2;
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use serde::{Deserialize, Serialize};

/// Slack of the work area, mm: rounding of placed coordinates.
const SLACK_MM: f64 = 1e-6;

/// Machine coordinates = input coordinates + offset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PartTransform {
    /// Machine coordinates of the input's origin, mm.
    pub offset_mm: [f64; 3],
}

impl PartTransform {
    /// `settings.at_mm`, or the part's box centred over the work area with its lowest point on
    /// the bed. `height_mm` is how far the part rises above its own z = 0.
    pub fn choose(
        bounds: Box2,
        height_mm: f64,
        settings: &Settings,
    ) -> Result<PartTransform, Refusal> {
        PartTransform::choose_box(bounds, [0.0, height_mm], settings)
    }

    /// The same for a part that reaches from the first to the second height above its own z = 0.
    pub fn choose_box(
        bounds: Box2,
        heights_mm: [f64; 2],
        settings: &Settings,
    ) -> Result<PartTransform, Refusal> {
        let [low, high] = settings.work_area_mm;
        let size = bounds.size();
        if size.x > high[0] - low[0] + SLACK_MM || size.y > high[1] - low[1] + SLACK_MM {
            return Err(refusal!(
                "the part is {:.3} x {:.3} mm, the work area {} x {} mm: scale it down (--scale) or use a larger machine",
                size.x,
                size.y,
                high[0] - low[0],
                high[1] - low[1]
            ));
        }
        let (height_mm, area_height_mm) = (heights_mm[1] - heights_mm[0], high[2] - low[2]);
        if settings.layers > 1 && height_mm > area_height_mm + SLACK_MM {
            return Err(refusal!(
                "the print is {height_mm:.3} mm high, the work area {area_height_mm} mm: print at most \
                 {} layers (--layers), thinner ones, or use a larger machine",
                ((area_height_mm + SLACK_MM) / settings.layer_height_mm) as u32
            ));
        }
        let centre = |axis: usize| (low[axis] + high[axis]) / 2.0;
        let offset_mm = settings.at_mm.unwrap_or([
            centre(0) - (bounds.min.x + bounds.max.x) / 2.0,
            centre(1) - (bounds.min.y + bounds.max.y) / 2.0,
            low[2] - heights_mm[0],
        ]);
        let extremes = [
            ("x", 0, bounds.min.x, bounds.max.x),
            ("y", 1, bounds.min.y, bounds.max.y),
            ("z", 2, heights_mm[0], heights_mm[1]),
        ];
        for (axis, k, part_low, part_high) in extremes {
            for (value_mm, limit_mm, over_mm) in [
                (
                    part_low + offset_mm[k],
                    low[k],
                    low[k] - part_low - offset_mm[k],
                ),
                (
                    part_high + offset_mm[k],
                    high[k],
                    part_high + offset_mm[k] - high[k],
                ),
            ] {
                if over_mm > SLACK_MM || over_mm.is_nan() {
                    return Err(refusal!(
                        "placed by --at, the part reaches {axis} = {value_mm:.3} mm, but the work area ends at \
                         {limit_mm} mm: move it by {over_mm:.3} mm"
                    ));
                }
            }
        }
        Ok(PartTransform { offset_mm })
    }

    /// How far the part may be moved within the work area, mm: along x and y, least and most.
    pub fn room_mm(&self, bounds: Box2, settings: &Settings) -> [[f64; 2]; 2] {
        let [low, high] = settings.work_area_mm;
        let part = [[bounds.min.x, bounds.max.x], [bounds.min.y, bounds.max.y]];
        std::array::from_fn(|axis| {
            let [from, to] = part[axis].map(|end| end + self.offset_mm[axis]);
            [(low[axis] - from).min(0.0), (high[axis] - to).max(0.0)]
        })
    }

    /// Machine -> input coordinates of a point.
    pub fn to_input(&self, machine_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| machine_mm[axis] - self.offset_mm[axis])
    }

    /// Input -> machine coordinates of a point.
    pub fn to_machine(&self, input_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| input_mm[axis] + self.offset_mm[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;

    fn bounds(x: f64, y: f64, width: f64, height: f64) -> Box2 {
        Box2 {
            min: Point2::new(x, y),
            max: Point2::new(x + width, y + height),
        }
    }

    #[test]
    fn the_default_centres_the_box_on_the_bed() {
        let settings = Settings::default();
        let part = bounds(1000.0, -20.0, 30.0, 10.0);
        let transform = PartTransform::choose(part, 0.2, &settings).expect("fits");
        assert_eq!(
            transform.to_machine([1015.0, -15.0, 0.0]),
            [125.0, 125.0, 0.0]
        );
        assert_eq!(
            transform.to_input([125.0, 125.0, 0.0]),
            [1015.0, -15.0, 0.0]
        );
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let mut settings = Settings::default();
        let wide = bounds(0.0, 0.0, 251.0, 10.0);
        let error = PartTransform::choose(wide, 0.2, &settings).expect_err("too wide");
        assert!(
            error
                .to_string()
                .starts_with("the part is 251.000 x 10.000 mm, "),
            "{error}"
        );
        settings.at_mm = Some([245.0, 0.0, 0.0]);
        let error = PartTransform::choose(bounds(0.0, 0.0, 10.0, 10.0), 0.2, &settings)
            .expect_err("beyond x");
        assert!(error.to_string().contains("x = 255.000 mm"), "{error}");
        settings.at_mm = Some([0.0, 0.0, 0.0]);
        assert!(PartTransform::choose(bounds(0.0, 0.0, 250.0, 250.0), 0.2, &settings).is_ok());
    }

    #[test]
    fn a_print_may_be_as_high_as_the_work_area() {
        let mut settings = Settings::default();
        let part = bounds(0.0, 0.0, 10.0, 10.0);
        settings.layers = 1000;
        assert!(PartTransform::choose(part, 200.0, &settings).is_ok());
        settings.layers = 1001;
        let error = PartTransform::choose(part, 200.2, &settings).expect_err("too high");
        let text = error.to_string();
        assert!(text.contains("200.200 mm high"), "{text}");
        assert!(text.contains("at most 1000 layers"), "{text}");
        settings.layers = 100;
        settings.at_mm = Some([0.0, 0.0, 181.0]);
        let error = PartTransform::choose(part, 20.0, &settings).expect_err("beyond z");
        assert!(error.to_string().contains("z = 201.000 mm"), "{error}");
    }
}
