//! Goal: a project is interpreted as in the slicer that wrote it, and settings that are not applied are
//! reported. Method: packages like those of PrusaSlicer, OrcaSlicer and Cura, of boxes whose volumes and
//! positions are computed by hand.

use crate::mesh::layers::{LayerHeights, SlicedPart, sliced_carved};
use crate::mesh::test_meshes::{cuboid, joined, model_3mf, object_3mf, to_3mf, to_package};
use crate::mesh::{LoadedMesh, Mesh, MeshFormat, MeshOptions, SurfaceRegion, read, read_surface};
use crate::text::refusal::Refusal;

const MODEL: &str = "3D/3dmodel.model";
const UPPER: [f64; 3] = [0.0, 0.0, 5.0];

fn loaded(bytes: &[u8]) -> Result<LoadedMesh, Refusal> {
    read(bytes, "part", MeshFormat::ThreeMf, &MeshOptions::default())
}

fn by_layers(part: &LoadedMesh) -> Result<SlicedPart, Refusal> {
    let heights = LayerHeights {
        first_mm: 0.2,
        layer_mm: 0.2,
        ranges: Vec::new(),
        range: None,
    };
    sliced_carved(&part.mesh, &part.carved, &heights)
}

/// The volume of a package's layers, mm³, its lowest and highest point, mm, and its notes.
fn printed(bytes: &[u8]) -> (f64, [f64; 2], Vec<String>) {
    let part = loaded(bytes).expect("readable");
    let [low, high] = part.bounds_mm();
    let layers = by_layers(&part).expect("layers");
    let volume_mm3 = (layers.volume_mm3() * 1e3).round() / 1e3;
    (volume_mm3, [low.z, high.z], part.notes)
}

fn has(notes: &[String], words: &[&str]) -> bool {
    notes
        .iter()
        .any(|note| words.iter().all(|word| note.contains(word)))
}

/// A plate of 20 x 20 x 5 mm, a slot of 10 x 10 mm through it, a core, and boxes over and below it.
fn volumes() -> [Mesh; 5] {
    [
        cuboid([0.0; 3], [20.0, 20.0, 5.0]),
        cuboid([5.0, 5.0, -1.0], [10.0, 10.0, 7.0]),
        cuboid([1.0, 1.0, 1.0], [3.0, 3.0, 3.0]),
        cuboid([0.0, 0.0, -8.0], [20.0, 20.0, 4.0]),
        cuboid([30.0, 0.0, 0.0], [5.0, 5.0, 9.0]),
    ]
}

/// What PrusaSlicer keeps of an object whose boxes have twelve triangles each.
fn prusa_config(volumes: &[(&str, &str)]) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<config>\n");
    text += " <object id=\"1\" instances_count=\"1\">\n";
    text += "  <metadata type=\"object\" key=\"name\" value=\"plate\"/>\n";
    text += "  <metadata type=\"object\" key=\"fill_density\" value=\"40%\"/>\n";
    for (number, (name, metadata)) in volumes.iter().enumerate() {
        let (first, last) = (12 * number, 12 * number + 11);
        text += &format!("  <volume firstid=\"{first}\" lastid=\"{last}\">\n");
        text += &format!("   <metadata type=\"volume\" key=\"name\" value=\"{name}\"/>\n");
        text += &format!("   {metadata}\n");
        text += "   <metadata type=\"volume\" key=\"source_offset_x\" value=\"10\"/>\n";
        text += "  </volume>\n";
    }
    text + " </object>\n</config>\n"
}

fn volume_type(word: &str) -> String {
    format!("<metadata type=\"volume\" key=\"volume_type\" value=\"{word}\"/>")
}

/// Goal: PrusaSlicer's volumes count as it means them: 1,500 mm³ from the bed up, where 3,800 came out of
/// it that reached 8 mm below the bed. Method: a plate with a volume of each kind; one of an old project
/// that has no types.
#[test]
fn volumes_of_prusaslicer_have_roles() {
    let all = volumes().into_iter().reduce(joined_pair).expect("boxes");
    let model = model_3mf("millimeter", &object_3mf(1, &all), "<item objectid=\"1\"/>");
    let words = [
        "ModelPart",
        "NegativeVolume",
        "ParameterModifier",
        "SupportBlocker",
        "SupportEnforcer",
    ];
    let types = words.map(volume_type);
    let mut core = types[2].clone();
    core += "<metadata type=\"volume\" key=\"perimeters\" value=\"5\"/>";
    let config = prusa_config(&[
        ("body", &types[0]),
        ("slot", &types[1]),
        ("core", &core),
        ("below", &types[3]),
        ("over", &types[4]),
    ]);
    let files = [
        (MODEL, model.as_str()),
        ("Metadata/Slic3r_PE_model.config", &config),
        ("Metadata/Slic3r_PE.config", "; perimeters = 3\n"),
    ];
    let (volume_mm3, heights_mm, notes) = printed(&to_package(&files));
    assert_eq!((volume_mm3, heights_mm), (1500.0, [0.0, 5.0]));
    assert!(
        has(&notes, &["cut away", "1 negative volume (slot)"]),
        "{notes:?}"
    );
    assert!(
        has(
            &notes,
            &[
                "left out",
                "1 modifier (core)",
                "1 support blocker (below)",
                "1 support enforcer (over)"
            ]
        ),
        "{notes:?}"
    );
    let own = "settings of 2 objects and modifiers are not followed";
    assert!(has(&notes, &[own]), "{notes:?}");
    assert!(has(&notes, &["settings of the project"]), "{notes:?}");

    let [body, _, core, ..] = volumes();
    let model = model_3mf(
        "millimeter",
        &object_3mf(1, &joined(body, &core)),
        "<item objectid=\"1\"/>",
    );
    let old = "<metadata type=\"volume\" key=\"modifier\" value=\"1\"/>";
    let config = prusa_config(&[("body", ""), ("core", old)]);
    let files = [
        (MODEL, model.as_str()),
        ("Metadata/Slic3r_PE_model.config", &config),
    ];
    let (volume_mm3, _, notes) = printed(&to_package(&files));
    assert_eq!(volume_mm3, 2000.0);
    assert!(has(&notes, &["1 modifier (core)"]), "{notes:?}");
}

fn joined_pair(one: Mesh, other: Mesh) -> Mesh {
    joined(one, &other)
}

/// Goal: the parts of OrcaSlicer and Bambu Studio count as they mean them, and are found in the files
/// that their components name. Method: the same plate; another file has an object of the same number.
#[test]
fn parts_of_orcaslicer_have_roles() {
    let objects: String = (1..)
        .zip(volumes())
        .map(|(id, mesh)| object_3mf(id, &mesh))
        .collect();
    let parts = model_3mf("millimeter", &objects, "");
    let other = model_3mf(
        "millimeter",
        &object_3mf(1, &cuboid([0.0; 3], [1.0; 3])),
        "",
    );
    let component = |id: usize| {
        format!(
            "<component p:path=\"/3D/Objects/object_2.model\" objectid=\"{id}\" \
             p:UUID=\"0001000{id}-b206-40ff-9872-83e8017abed1\" transform=\"1 0 0 0 1 0 0 0 1 0 0 0\"/>"
        )
    };
    let components: String = (1..=5).map(component).collect();
    let object = format!(
        "<object id=\"9\" p:UUID=\"00000009-61cb-4c03-9d28-80fed5dfa1dc\" type=\"model\"><components>\
         {components}</components></object>"
    );
    let root = model_3mf(
        "millimeter",
        &object,
        "<item objectid=\"9\" transform=\"1 0 0 0 1 0 0 0 1 100 100 2\" printable=\"1\"/>",
    );
    let subtypes = [
        "normal_part",
        "negative_part",
        "modifier_part",
        "support_blocker",
        "support_enforcer",
    ];
    let config_part = |(id, subtype): (usize, &str)| {
        format!(
            "<part id=\"{id}\" subtype=\"{subtype}\"><metadata key=\"name\" value=\"p{id}\"/>\
             <metadata key=\"matrix\" value=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\"/>\
             <metadata key=\"extruder\" value=\"0\"/><mesh_stat edges_fixed=\"0\"/></part>"
        )
    };
    let config_parts: String = (1..).zip(subtypes).map(config_part).collect();
    let plate = |number: usize| {
        format!(
            "<plate><metadata key=\"plater_id\" value=\"{number}\"/><model_instance>\
             <metadata key=\"object_id\" value=\"9\"/></model_instance></plate>"
        )
    };
    let config = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><config><object id=\"9\"><metadata key=\"name\" \
         value=\"plate\"/><metadata key=\"extruder\" value=\"1\"/><metadata key=\"wall_loops\" value=\"4\"/>\
         {config_parts}</object>{}{}</config>",
        plate(1),
        plate(2)
    );
    let files = [
        ("3D/Objects/object_1.model", other.as_str()),
        ("3D/Objects/object_2.model", &parts),
        (MODEL, &root),
        ("Metadata/model_settings.config", &config),
        (
            "Metadata/project_settings.config",
            "{\"wall_loops\": \"2\"}",
        ),
    ];
    let (volume_mm3, heights_mm, notes) = printed(&to_package(&files));
    assert_eq!((volume_mm3, heights_mm), (1500.0, [2.0, 7.0]));
    let aside = [
        "1 modifier (p3)",
        "1 support blocker (p4)",
        "1 support enforcer (p5)",
    ];
    assert!(has(&notes, &aside), "{notes:?}");
    assert!(has(&notes, &["1 negative volume (p2)"]), "{notes:?}");
    let own = "settings of 1 object or modifier are not followed";
    assert!(has(&notes, &[own]), "{notes:?}");
    assert!(has(&notes, &["2 plates"]), "{notes:?}");

    // A further instance, as an object that has the first one as its component.
    let again = "<object id=\"10\" type=\"model\"><components><component objectid=\"9\"/></components></object>";
    let items =
        "<item objectid=\"9\"/><item objectid=\"10\" transform=\"1 0 0 0 1 0 0 0 1 60 0 0\"/>";
    let root = model_3mf("millimeter", &(object + again), items);
    let mut files = files;
    files[2].1 = &root;
    let (volume_mm3, _, notes) = printed(&to_package(&files));
    assert_eq!(volume_mm3, 2.0 * 1500.0);
    assert!(has(&notes, &["2 modifiers (p3)"]), "{notes:?}");
}

/// Goal: Cura's objects that are no material are none, of new projects and of old ones. Method: a plate
/// of 2,000 mm³ and a box of each kind, grouped by an object of components.
#[test]
fn meshes_of_cura_have_roles() {
    let [body, ..] = volumes();
    let tool = cuboid([5.0, 5.0, 3.0], [4.0, 4.0, 9.0]);
    let with = |id: u32, mesh: &Mesh, settings: &str| {
        let object = object_3mf(id, mesh);
        object.replacen("<mesh>", &format!("{settings}<mesh>"), 1)
    };
    let group = |name: &str| {
        format!(
            "<metadatagroup><metadata name=\"cura:{name}\" preserve=\"true\" type=\"xs:boolean\">True\
             </metadata><metadata name=\"cura:drop_to_buildplate\">True</metadata></metadatagroup>"
        )
    };
    let old = "<settings xmlns=\"http://software.ultimaker.com/xml/cura/3mf/2015/10\"><setting \
               key=\"infill_mesh\">true</setting><setting key=\"infill_sparse_density\">80</setting></settings>";
    let off =
        "<metadatagroup><metadata name=\"cura:support_mesh\">False</metadata></metadatagroup>";
    let mut objects = with(1, &body, off);
    objects += &with(2, &tool, &group("anti_overhang_mesh"));
    objects += &with(3, &tool, &group("cutting_mesh"));
    objects += &with(4, &tool, &group("support_mesh"));
    objects += &with(5, &tool, old);
    let components: String = (2..=5)
        .map(|id| format!("<component objectid=\"{id}\"/>"))
        .collect();
    objects +=
        &format!("<object id=\"6\" type=\"model\"><components>{components}</components></object>");
    let items = "<item objectid=\"1\"/><item objectid=\"6\"/>";
    let bytes = to_3mf(&model_3mf("millimeter", &objects, items));
    let (volume_mm3, heights_mm, notes) = printed(&bytes);
    assert_eq!((volume_mm3, heights_mm), (2000.0, [0.0, 5.0]));
    let aside = ["2 modifiers", "1 support blocker", "1 support object"];
    assert!(has(&notes, &aside), "{notes:?}");
    let own = "settings of 1 object or modifier are not followed";
    assert!(has(&notes, &[own]), "{notes:?}");
}

/// Goal: what is switched off and objects of type `other` and `support` are not printed; resources may
/// stand in any order. Method: four objects between materials, of which one is printed.
#[test]
fn what_is_switched_off_is_not_printed() {
    let cube = cuboid([0.0; 3], [10.0; 3]);
    let object = |id: u32, kind: &str| {
        object_3mf(id, &cube).replacen("type=\"model\"", &format!("type=\"{kind}\""), 1)
    };
    let colours = |id: u32| {
        format!(
            "<basematerials id=\"{id}\"><base name=\"PLA\" displaycolor=\"#FFFFFF\"/></basematerials>"
        )
    };
    let resources = [
        object(1, "model"),
        colours(7),
        object(2, "other"),
        colours(8),
        object(3, "support"),
        object(4, "model"),
    ]
    .concat();
    let items = "<item objectid=\"2\"/><item objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 0 0 3\"/>\
                 <item objectid=\"3\"/><item objectid=\"4\" printable=\"0\"/>";
    let (volume_mm3, heights_mm, notes) =
        printed(&to_3mf(&model_3mf("millimeter", &resources, items)));
    assert_eq!((volume_mm3, heights_mm), (1000.0, [3.0, 13.0]));
    assert!(has(&notes, &["1 item that is switched off"]), "{notes:?}");
    let kinds = ["1 object of type `other`", "1 support object"];
    assert!(has(&notes, &kinds), "{notes:?}");
    assert!(!has(&notes, &["not followed"]), "{notes:?}");

    let items = "<item objectid=\"2\"/><item objectid=\"4\" printable=\"0\"/>";
    let nothing = loaded(&to_3mf(&model_3mf("millimeter", &resources, items)));
    let refused = nothing.expect_err("nothing to print").to_string();
    assert!(
        refused.starts_with("nothing in it is printed: "),
        "{refused}"
    );
}

/// Goal: a negative volume cuts its own object only, in each of its places, and a first layer that is
/// cut away is refused. Method: two objects over each other, one of them placed twice; volumes by hand.
#[test]
fn a_negative_volume_cuts_its_own_object() {
    let [body, slot, ..] = volumes();
    let upper = object_3mf(2, &cuboid(UPPER, [20.0, 20.0, 5.0]));
    let objects = object_3mf(1, &joined(body.clone(), &slot)) + &upper;
    let items = "<item objectid=\"1\"/><item objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 40 0 0\"/>\
                 <item objectid=\"2\"/>";
    let config = prusa_config(&[("body", ""), ("slot", &volume_type("NegativeVolume"))]);
    let package = |objects: &str, items: &str| {
        let model = model_3mf("millimeter", objects, items);
        to_package(&[
            (MODEL, model.as_str()),
            ("Metadata/Slic3r_PE_model.config", &config),
        ])
    };
    let (volume_mm3, _, notes) = printed(&package(&objects, items));
    assert_eq!(volume_mm3, 2.0 * 1500.0 + 2000.0);
    assert!(has(&notes, &["2 negative volumes (slot)"]), "{notes:?}");

    let below = cuboid([-1.0, -1.0, -1.0], [22.0, 22.0, 2.0]);
    let object = object_3mf(1, &joined(body, &below));
    let part = loaded(&package(&object, "<item objectid=\"1\"/>")).expect("readable");
    let refused = by_layers(&part).expect_err("cut away").to_string();
    let text = "the negative volumes leave nothing of the first layer, 0.2 mm high, ";
    assert!(refused.starts_with(text), "{refused}");
}

/// Goal: what a project asks for and does not get is said, once for each kind. Method: files and
/// attributes of PrusaSlicer's and of Bambu Studio's.
#[test]
fn what_is_not_followed_is_said() {
    let cube = object_3mf(1, &cuboid([0.0; 3], [10.0; 3]));
    let painted = cube
        .replacen("<triangle ", "<triangle slic3rpe:custom_supports=\"4\" ", 1)
        .replacen("<triangle v", "<triangle paint_supports=\"4\" v", 1)
        .replacen("<triangle v", "<triangle paint_seam=\"8\" v", 1);
    let model = model_3mf("millimeter", &painted, "<item objectid=\"1\"/>");
    let ranges = "<?xml version=\"1.0\" encoding=\"utf-8\"?><objects><object id=\"1\"><range min_z=\"0\" \
                  max_z=\"2\"><option opt_key=\"extruder\">0</option><option opt_key=\"layer_height\">0.1\
                  </option></range><range min_z=\"4\" max_z=\"6\"><option opt_key=\"layer_height\">0.3\
                  </option></range></object></objects>";
    let codes = "<?xml version=\"1.0\" encoding=\"utf-8\"?><custom_gcodes_per_print_z><code print_z=\"5.2\" \
                 type=\"1\" extruder=\"1\" color=\"\" extra=\"\" gcode=\"M601\"/><code print_z=\"7\" type=\"0\" \
                 extruder=\"1\" color=\"#FF0000\" extra=\"\" gcode=\"M600\"/><mode value=\"SingleExtruder\"/>\
                 </custom_gcodes_per_print_z>";
    let bambu_codes = "<custom_gcodes_per_layer><plate><plate_info id=\"1\"/><layer top_z=\"3\" type=\"4\" \
                       gcode=\"M117\"/></plate></custom_gcodes_per_layer>";
    let files = [
        (MODEL, model.as_str()),
        ("Metadata/Slic3r_PE_layer_config_ranges.xml", ranges),
        ("Metadata/Prusa_Slicer_custom_gcode_per_print_z.xml", codes),
        ("Metadata/custom_gcode_per_layer.xml", bambu_codes),
        (
            "Metadata/Slic3r_PE_layer_heights_profile.txt",
            "object_id=2|0;0.2;10;0.1\n",
        ),
        ("Metadata/thumbnail.png", "no text"),
    ];
    let (volume_mm3, _, notes) = printed(&to_package(&files));
    assert_eq!(volume_mm3, 1000.0);
    assert_eq!(notes.len(), 3, "{notes:?}");
    let paints = ["supports on 2 triangles", "seams on 1 triangle"];
    assert!(has(&notes, &paints), "{notes:?}");
    let codes = ["pause at 5.2 mm", "colour change at 7 mm", "G-code at 3 mm"];
    assert!(has(&notes, &codes), "{notes:?}");
    let own = "settings of height ranges are not followed";
    assert!(has(&notes, &[own]), "{notes:?}");
}

/// A square of two triangles at a height, as an object of a 3MF with attributes of its own, and those of its triangles.
fn square(id: u32, z_mm: f64, own: &str, of_triangles: [&str; 2]) -> String {
    let corners = [[0, 0], [4, 0], [4, 4], [0, 4]];
    let vertex = |[x, y]: [i32; 2]| format!("<vertex x=\"{x}\" y=\"{y}\" z=\"{z_mm}\"/>");
    let vertices: String = corners.map(vertex).concat();
    let [one, other] = of_triangles;
    format!(
        "<object id=\"{id}\" {own}><mesh><vertices>{vertices}</vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\" \
         {one}/><triangle v1=\"0\" v2=\"2\" v3=\"3\" {other}/></triangles></mesh></object>"
    )
}

/// Goal: triangles of a 3MF are found by the names of the objects and components they are of, and by the colour of all
/// three corners. Method: squares of 16 mm² at heights of 1 to 4 mm, of which the first two are components of a third
/// object; colours of a base material, of a colour group with an opacity, of an object and of its triangles; which triangles
/// are left is seen by height and area.
#[test]
fn regions_are_found_by_name_and_colour() {
    let resources = [
        square(3, 1.0, "name=\"lid\"", ["pid=\"1\" p1=\"1\"", ""]),
        square(4, 2.0, "name=\"rim\" pid=\"2\" pindex=\"0\"", ["", "p1=\"1\""]),
        square(
            5,
            3.0,
            "name=\"foot\" pid=\"1\" pindex=\"0\"",
            ["pid=\"2\" p1=\"0\" p2=\"0\" p3=\"1\"", "pid=\"9\" p1=\"0\""],
        ),
        // Resources may come after what they are of.
        "<basematerials id=\"1\"><base name=\"PLA\" displaycolor=\"#0000FF\"/><base name=\"TPU\" \
         displaycolor=\"#ff8000\"/></basematerials>"
            .to_string(),
        "<m:colorgroup id=\"2\"><m:color color=\"#FF8000C0\"/><m:color color=\"#00FF00\"/></m:colorgroup>".to_string(),
        "<object id=\"6\" name=\"cap\"><components><component objectid=\"3\"/><component objectid=\"4\"/></components>\
         </object>"
            .to_string(),
    ]
    .concat();
    let items = "<item objectid=\"6\"/><item objectid=\"5\"/><item objectid=\"3\" transform=\"1 0 0 0 1 0 0 0 1 0 0 3\"/>";
    let model = model_3mf("millimeter", &resources, items);
    let bytes = to_package(&[(MODEL, model.as_str())]);
    // Height and number of triangles.
    let left = |region: SurfaceRegion| -> Vec<(f64, usize)> {
        let options = MeshOptions::default();
        let mesh =
            read_surface(&bytes, MeshFormat::ThreeMf, &options, Some(&region)).expect("some");
        let mut heights: Vec<f64> = (0..mesh.triangles.len())
            .map(|number| mesh.corners(number)[0].z)
            .collect();
        heights.sort_by(f64::total_cmp);
        let runs = heights.chunk_by(|a, b| a == b);
        runs.map(|run| (run[0], run.len())).collect()
    };
    let group = |name: &str| SurfaceRegion::Group(name.to_string());
    assert_eq!(left(group("cap")), [(1.0, 2), (2.0, 2)]);
    assert_eq!(left(group("lid")), [(1.0, 2), (4.0, 2)]);
    assert_eq!(left(group("foot")), [(3.0, 2)]);
    // One triangle of each lid by its base material, one of the rim by its object's colour.
    let orange = SurfaceRegion::Colour([0xff, 0x80, 0]);
    assert_eq!(left(orange), [(1.0, 1), (2.0, 1), (4.0, 1)]);
    assert_eq!(left(SurfaceRegion::Colour([0, 0xff, 0])), [(2.0, 1)]);
    // Of the foot one triangle has corners that differ, one a group that there is not.
    let options = MeshOptions::default();
    let none = |region| read_surface(&bytes, MeshFormat::ThreeMf, &options, Some(&region)).err();
    let text =
        "no triangle of the surface is in the requested region; its groups: cap, foot, lid, rim";
    let refused = Some(Refusal(text.to_string()));
    assert_eq!(none(SurfaceRegion::Colour([0, 0, 0xff])), refused);
    assert_eq!(none(group("hat")), refused);
}
