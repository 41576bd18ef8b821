//! The readers of meshes and what cuts them: no panic, what is taken is finite, an error that can be
//! printed. The first byte chooses the format; a 3MF package is made around the bytes, so that they are
//! the model and not its compression.
#![no_main]

use headway::mesh::layers::{LayerHeights, sliced_carved};
use headway::mesh::{MeshFormat, MeshOptions, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    let format = match kind % 3 {
        0 => MeshFormat::Stl,
        1 => MeshFormat::Obj,
        _ => MeshFormat::ThreeMf,
    };
    let packed;
    let bytes = match format {
        MeshFormat::ThreeMf => {
            packed = headway_fuzz::package::of_model(bytes);
            &packed
        }
        _ => bytes,
    };
    match read(bytes, "fuzz", format, &MeshOptions::default()) {
        Ok(loaded) => {
            assert!(loaded.mesh.volume_mm3().is_finite());
            let [low, high] = loaded.mesh.bounds_mm();
            let height_mm = ((high.z - low.z) / 8.0).max(0.01);
            let heights = LayerHeights {
                first_mm: height_mm,
                layer_mm: height_mm,
                ranges: Vec::new(),
                range: None,
            };
            match sliced_carved(&loaded.mesh, &loaded.carved, &heights) {
                Ok(part) => assert!(part.volume_mm3().is_finite()),
                Err(error) => assert!(!error.to_string().is_empty()),
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
