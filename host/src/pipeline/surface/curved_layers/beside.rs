//! What does not go with curved layers, and what to do instead.
//!
//! In: an option or a kind of input. Out: the refusal's text, the same for the command and for library users.

/// What is given beside curved layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beside {
    /// Outlines that nothing enters.
    KeepOut,
    /// Some of the layers.
    LayerRange,
    /// Layers of several heights.
    LayerHeights,
    /// A first layer of another height.
    FirstLayerHeight,
    /// A first layer of another speed.
    FirstLayerSpeed,
    /// Plans kept from an earlier run.
    Cache,
    /// Several of the part.
    Copies,
    /// Volumes that are cut away from others.
    Carved,
}

impl Beside {
    /// Why it is refused, and what to do.
    pub fn refusal(self) -> &'static str {
        match self {
            Beside::KeepOut => {
                "--keep-out does not go with --curved-layers, whose travel goes straight above all that is printed: leave one \
                 of them out, or place the part elsewhere with --at"
            }
            Beside::LayerRange => {
                "--layer-range does not go with --curved-layers: a curved layer lies beside and over several others, and has no \
                 number of its own; cut the mesh where the print is to end, or leave one of them out"
            }
            Beside::LayerHeights => {
                "--layer-heights does not go with --curved-layers, which choose their own thickness: give one --layer-height"
            }
            Beside::FirstLayerHeight => {
                "--first-layer-height does not go with --curved-layers, which choose their own thickness: give one --layer-height"
            }
            Beside::FirstLayerSpeed => {
                "--first-layer-speed does not go with --curved-layers: give a lower --speed, or leave one of them out"
            }
            Beside::Cache => {
                "--cache does not go with --curved-layers, whose plans are not kept: leave --cache out, and the part is planned anew"
            }
            Beside::Copies => {
                "--copies and a second --at do not go with --curved-layers: put the parts beside each other in one mesh file (each has \
                 its own curved layers), or print the job once for each with --at X,Y,Z"
            }
            Beside::Carved => {
                "--curved-layers: the file cuts volumes away from its objects; export the part as one mesh"
            }
        }
    }
}
