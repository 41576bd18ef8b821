//! Settings that are one of a few by name, each declared once: its names in machine files, on the command line and for
//! programs, with its help.

use serde::{Deserialize, Serialize};

/// What is one of a few by name.
pub(super) trait Choice: Copy + serde::de::DeserializeOwned {
    /// Its name.
    fn choice_name(self) -> &'static str;
}

/// Declares an enum whose names in files and options are its variants in lower case.
macro_rules! choice {
    ($(#[$attribute:meta])* $name:ident { $($(#[$help:meta])* $variant:ident = $text:literal,)+ }) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[cfg_attr(feature = "command", derive(clap::ValueEnum))]
        #[serde(rename_all = "lowercase")]
        pub enum $name {
            $($(#[$help])* $variant,)+
        }

        impl $name {
            /// All of them by name.
            pub const NAMES: &[(&str, $name)] = &[$(($text, $name::$variant)),+];

            /// Its name.
            pub fn name(self) -> &'static str {
                match self {
                    $($name::$variant => $text,)+
                }
            }
        }

        impl Choice for $name {
            fn choice_name(self) -> &'static str {
                self.name()
            }
        }
    };
}

choice! {
    /// How passes are laid where the passage is narrow.
    PassMode {
        /// Two passes, one along either wall; one where two do not fit, or where that takes less.
        Two = "two",
        /// One pass between the walls wherever the aperture spans them.
        One = "one",
    }
}

choice! {
    /// How the local width becomes a heading angle.
    HeadingLaw {
        /// The angle at which the aperture just touches what it should.
        Tangent = "tangent",
        /// (1 - w) 90°, as published.
        Linear = "linear",
    }
}

choice! {
    /// What ground is worth: the price at which the planner leaves ground open or lays it twice to
    /// print sooner.
    #[derive(Default)]
    Quality {
        /// Hardly anything stays open: the longest print.
        Fine = "fine",
        /// Small voids that the material closes are left where filling them takes long.
        #[default]
        Standard = "standard",
        /// Voids of some tenths of a mm² are left.
        Fast = "fast",
    }
}

choice! {
    /// Which place of a loop is its seam.
    SeamPlace {
        /// The smooth place nearest to where the head is.
        Nearest = "nearest",
        /// Farthest along a direction.
        Aligned = "aligned",
        /// In the sharpest corner.
        Sharpest = "sharpest",
    }
}

choice! {
    /// What a pump's output can be.
    #[derive(Default)]
    PumpKind {
        /// Its value is the flow.
        #[default]
        Analog = "analog",
        /// On and off.
        Digital = "digital",
    }
}

choice! {
    /// What corrects the flow of a running print.
    #[derive(Default)]
    FlowController {
        /// The sensor program's own flow.
        #[default]
        Flow = "flow",
        /// Scans of layers set the flow of the next ones.
        Layer = "layer",
        /// The pump's pressure is kept.
        Pressure = "pressure",
    }
}

choice! {
    /// Where a run of waypoints lies.
    #[derive(Default)]
    Place {
        /// Its box centred over the work area.
        #[default]
        Centre = "centre",
        /// Where the machine reaches all of it and takes least time.
        Best = "best",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: the names that are listed are those that files are read by. Method: each through the reader of files.
    #[test]
    fn names_are_those_of_files() {
        fn check<T: PartialEq + std::fmt::Debug + serde::de::DeserializeOwned>(
            names: &[(&str, T)],
        ) {
            for (name, meant) in names {
                let read: T = serde_json::from_value((*name).into()).expect("a name");
                assert_eq!(read, *meant);
            }
        }
        check(PassMode::NAMES);
        check(HeadingLaw::NAMES);
        check(Quality::NAMES);
        check(SeamPlace::NAMES);
        check(Place::NAMES);
        check(PumpKind::NAMES);
        check(FlowController::NAMES);
    }
}
