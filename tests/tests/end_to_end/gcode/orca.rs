//! Goal: a file as OrcaSlicer writes it is printed as it stands: its layers, widths, heights, arcs and volumes, and
//! what stands in its start and end blocks changes none of it. Method: files written here after the comments and
//! blocks that OrcaSlicer documents, for a printer with a filament changer and for one with Klipper; no file of
//! the program itself was at hand. Two layers of a rounded square: two walls of arcs, lines within them.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::gcode::comments::Slicer;
use headway::gcode::{GcodeOptions, GcodeProgram, read};
use headway::pipeline::gcode::plan_gcode;
use headway::settings::Settings;
use headway_tests::centre_line::beside;
use std::f64::consts::PI;
use std::fmt::Write;

const LAYER_MM: f64 = 0.2;
const FILAMENT_MM2: f64 = 0.25 * PI * 1.75 * 1.75;
const MIDDLE_MM: f64 = 120.0;
const ROUNDING_MM: f64 = 4.0;

/// Which comments and blocks.
#[derive(Clone, Copy, PartialEq)]
enum Printer {
    /// `; FEATURE:`, `; LINE_WIDTH:`, `; LAYER_HEIGHT:`, `; CHANGE_LAYER`.
    Changer,
    /// `;TYPE:`, `;WIDTH:`, `;HEIGHT:`, `;LAYER_CHANGE`.
    Klipper,
}

/// Filament of a bead with round sides, mm a mm.
fn filament_of(width_mm: f64) -> f64 {
    let side = 0.25 * PI * LAYER_MM * LAYER_MM;
    ((width_mm - LAYER_MM) * LAYER_MM + side) / FILAMENT_MM2
}

struct File {
    text: String,
    printer: Printer,
    extruded_mm: f64,
}

impl File {
    fn line(&mut self, line: &str) {
        self.text.push_str(line);
        self.text.push('\n');
    }

    fn kind(&mut self, name: &str, width_mm: f64, acceleration: u32) {
        match self.printer {
            Printer::Changer => self.line(&format!("; FEATURE: {name}\n; LINE_WIDTH: {width_mm}")),
            Printer::Klipper => self.line(&format!(";TYPE:{name}\n;WIDTH:{width_mm}")),
        }
        self.acceleration(acceleration);
    }

    fn acceleration(&mut self, mm_s2: u32) {
        match self.printer {
            Printer::Changer => self.line(&format!("M204 S{mm_s2}")),
            Printer::Klipper => self.line(&format!("SET_VELOCITY_LIMIT ACCEL={mm_s2}")),
        }
    }

    /// A bead, with filament as the file rounds it.
    fn bead(&mut self, words: &str, length_mm: f64, width_mm: f64) {
        let e_mm = (length_mm * filament_of(width_mm) * 1e5).round() / 1e5;
        self.extruded_mm += e_mm;
        self.line(&format!(
            "{words} E{}",
            format!("{e_mm:.5}").trim_start_matches('0')
        ));
    }

    /// A wall round the middle, counter-clockwise, its corners arcs.
    fn wall(&mut self, half_mm: f64, width_mm: f64) {
        let (m, straight, r) = (MIDDLE_MM, half_mm - ROUNDING_MM, ROUNDING_MM);
        self.travel(m + half_mm, m - straight);
        self.line("G1 F3600");
        let corners = [
            ([half_mm, straight], [straight, half_mm], [-r, 0.0]),
            ([-straight, half_mm], [-half_mm, straight], [0.0, -r]),
            ([-half_mm, -straight], [-straight, -half_mm], [r, 0.0]),
            ([straight, -half_mm], [half_mm, -straight], [0.0, r]),
        ];
        for ([x, y], [to_x, to_y], [i, j]) in corners {
            self.bead(
                &format!("G1 X{} Y{}", m + x, m + y),
                2.0 * straight,
                width_mm,
            );
            let words = format!("G3 X{} Y{} I{i} J{j}", m + to_x, m + to_y);
            self.bead(&words, 0.5 * PI * r, width_mm);
        }
    }

    fn travel(&mut self, x: f64, y: f64) {
        self.line("; WIPE_START\nG1 F9000");
        self.line("G1 E-.04 F1800\n; WIPE_END\nG1 E-.76 F1800");
        self.acceleration(5000);
        self.line(&format!("G1 X{x} Y{y} F15000\nG1 E.8 F1800"));
    }

    fn layer(&mut self, number: u32) {
        let z = LAYER_MM * f64::from(number + 1);
        match self.printer {
            Printer::Changer => {
                self.line(&format!(
                    "; CHANGE_LAYER\n; Z_HEIGHT: {z}\n; LAYER_HEIGHT: {LAYER_MM}"
                ));
                self.line(&format!("; layer num/total_layer_count: {}/2", number + 1));
                self.line(&format!(
                    "M73 L{}\nM991 S0 P{number} ;notify layer change",
                    number + 1
                ));
                self.line("; OBJECT_ID: 72\nM624 AQAAAAAAAAA=");
            }
            Printer::Klipper => {
                self.line(&format!(
                    ";BEFORE_LAYER_CHANGE\n;{z}\nG92 E0\n;LAYER_CHANGE\n;Z:{z}\n;HEIGHT:{LAYER_MM}"
                ));
                self.line("; printing object plate id:0 copy 0\nEXCLUDE_OBJECT_START NAME=plate_id_0_copy_0");
            }
        }
        self.line(if number == 0 { "M106 S0" } else { "M106 S102" });
        self.line(&format!("G1 Z{z} F600\nM73 P{} R1", 40 * (number + 1)));
        self.kind("Inner wall", 0.45, 3000);
        self.wall(9.565, 0.45);
        self.kind("Outer wall", 0.42, 2000);
        self.wall(10.0, 0.42);
        self.kind("Sparse infill", 0.45, 5000);
        let m = MIDDLE_MM;
        self.travel(m - 6.0, m - 9.0);
        self.line("G1 F6000");
        for k in 0..4 {
            let (x, top) = (
                m - 6.0 + 4.0 * f64::from(k),
                if k % 2 == 0 { 9.0 } else { -9.0 },
            );
            self.bead(&format!("G1 X{x} Y{}", m + top), 18.0, 0.45);
            if k < 3 {
                self.bead(&format!("G1 X{}", x + 4.0), 4.0, 0.45);
            }
        }
        match self.printer {
            // Up along a spiral, with the next layer's way.
            Printer::Changer => self.line(&format!(
                "G1 E-.8 F1800\nG17\nG3 Z{} I1.217 J0 P1 F15000\nG1 E.8 F1800\nM625",
                z + 0.4
            )),
            Printer::Klipper => self.line("EXCLUDE_OBJECT_END NAME=plate_id_0_copy_0"),
        }
    }
}

/// Start block of a printer with a changer: nozzle wiped in circles, conditions, a line to load it.
const CHANGER_START: &str = "\
; HEADER_BLOCK_START\n; generated by OrcaSlicer 2.1.1 on 2026-01-01 at 10:00:00\n\
; model printing time: 4m 31s; total estimated time: 10m 51s\n; total layer number: 2\n; filament_density: 1.24\n\
; filament_diameter: 1.75\n; max_z_height: 0.40\n; HEADER_BLOCK_END\n\n; CONFIG_BLOCK_START\n\
; change_filament_gcode = M620 S[next_extruder]A\\nT[next_extruder]\\nG1 E{flush_length_1} F50\n; layer_height = 0.2\n\
; line_width = 0.42\n; CONFIG_BLOCK_END\n\n; EXECUTABLE_BLOCK_START\nM73 P0 R10\nM201 X20000 Y20000 Z500 E5000\n\
M203 X500 Y500 Z20 E30\nM204 P20000 R5000 T20000\nM205 X9.00 Y9.00 Z3.00 E2.50\nM106 S0\nM106 P2 S0\n; FEATURE: Custom\n\
M104 S75\nM290 X40 Y40 Z2.6666666\nG91\nM17 Z0.4 ; lower the current\nG380 S2 Z30 F300\nG1 Z5 F300;\nG90\nM220 S100\n\
M221 S100\nM73.2   R1.0\nM1002 set_gcode_claim_speed_level : 5\nM221 X0 Y0 Z0 ; soft endstops off\nG29.1 Z0\nM204 S10000\n\
M140 S55\nM190 S55\nG28 X\nM620 M\nM620 S0A   ; switch material\n    M109 S220\n    T0\n    M400\nM621 S0A\n\
M620.1 E F523.843 T240\nM412 S1\nG92 E0\nM83\nG1 E50 F200\nM400\nM109 S200\nG1 E-0.5 F300\nM106 S255\nG1 X65 Y230 F18000\n\
G28 Z P0 T300; home with low precision\nG29.2 S0\nG0 X128 Y261 Z-1.5 F20000\nM221 S; push soft endstop status\nM221 Z0\n\
G2 I0.5 J0 F300\nG2 I0.5 J0 F3000\nM109 S140\nM221 R; pop softend status\nG1 Z10 F1200\nM622 J1\n    G29 A X83 Y98 I89 J59\n\
    M400\n    M500\nM623\nM970.3 Q1 A7 B30 C80  H15 K0\nM975 S1\nT1000\nG1 X100 Y90 Z0.8 F18000\nM109 S220\nG1 Z0.2\n\
G0 X130 E2 F3000\nM106 S0\nG90\nG21\nM83\nG1 E-.8 F1800\nM204 S6000\nG1 Z.6\nG1 E.8 F1800\n";

const CHANGER_END: &str = "\
M981 S0 P20000\n; FEATURE: Custom\nM400\nG92 E0\nG1 E-0.8 F1800\nG1 Z10 F900\nG1 X65 Y245 F12000\nM140 S0\nM106 S0\n\
M106 P2 S0\nM620 S255\nT255\nM621 S255\nM104 S0\nM17 S\nM17 R\nM220 S100\nM73 P100 R0\n; EXECUTABLE_BLOCK_END\n";

const KLIPPER_START: &str = "\
; HEADER_BLOCK_START\n; generated by OrcaSlicer 2.1.1 on 2026-01-01 at 10:00:00\n; total layer number: 2\n\
; HEADER_BLOCK_END\nM73 P0 R3\nEXCLUDE_OBJECT_DEFINE NAME=plate_id_0_copy_0 CENTER=120,120 POLYGON=[[110,110],[130,110]]\n\
SET_VELOCITY_LIMIT ACCEL=10000\nM190 S60\nM109 S215\nPRINT_START EXTRUDER=215 BED=60\nG90\nG21\nM83\n\
; filament start gcode\nSET_PRESSURE_ADVANCE ADVANCE=0.04; Override pressure advance value\nG1 Z.6 F600\nG1 E.8 F1800\n";

const KLIPPER_END: &str = "\
G1 E-.8 F1800\nPRINT_END\nM73 P100 R0\n; EXECUTABLE_BLOCK_END\n\n; filament used [mm] = 99.9\n\
; total layers count = 2\n; estimated printing time (normal mode) = 3m 42s\n\n; CONFIG_BLOCK_START\n\
; filament_diameter = 1.75\n; layer_height = 0.2\n; CONFIG_BLOCK_END\n";

/// A file and what its model extrudes, mm.
fn file(printer: Printer) -> (String, f64) {
    let (start, end) = match printer {
        Printer::Changer => (CHANGER_START, CHANGER_END),
        Printer::Klipper => (KLIPPER_START, KLIPPER_END),
    };
    let mut file = File {
        text: start.to_string(),
        printer,
        extruded_mm: 0.0,
    };
    file.layer(0);
    file.layer(1);
    write!(file.text, "{end}").expect("text");
    (file.text, file.extruded_mm)
}

fn read_file(text: &str) -> GcodeProgram {
    read(text.as_bytes(), "orca", &GcodeOptions::default()).expect("a file")
}

/// Widths of the beads of a length, told by comments.
fn length_of(program: &GcodeProgram, width_mm: f64) -> f64 {
    let legs = program.passes.iter().flat_map(|pass| {
        let lengths = pass
            .points
            .windows(2)
            .map(|pair| pair[1].distance_mm(&pair[0]));
        pass.legs.iter().zip(lengths)
    });
    let of_width = legs.filter(|(leg, _)| leg.width_mm == Some(width_mm));
    of_width.map(|(_, mm)| mm).sum()
}

#[test]
fn files_after_orca_slicer_are_printed_as_they_stand() {
    for printer in [Printer::Changer, Printer::Klipper] {
        let (text, extruded_mm) = file(printer);
        let program = read_file(&text);
        assert_eq!(program.slicer, Slicer::OrcaSlicer);
        assert_eq!(program.layers(), 2);
        // The changer's line that loads the nozzle is a bead of its own.
        let loading = usize::from(printer == Printer::Changer);
        assert_eq!(program.passes.len(), 6 + loading);
        let expected_s = if loading > 0 { 651.0 } else { 222.0 };
        assert_eq!(program.estimate_s, Some(expected_s));
        let outer_mm = 2.0 * (8.0 * (10.0 - ROUNDING_MM) + 2.0 * PI * ROUNDING_MM);
        assert!((length_of(&program, 0.42) - outer_mm).abs() < 0.02);
        let inner_mm = 2.0 * (8.0 * (9.565 - ROUNDING_MM) + 2.0 * PI * ROUNDING_MM);
        let infill_mm = 2.0 * (4.0 * 18.0 + 3.0 * 4.0);
        assert!((length_of(&program, 0.45) - inner_mm - infill_mm).abs() < 0.02);
        let legs = program
            .passes
            .iter()
            .skip(loading)
            .flat_map(|pass| &pass.legs);
        assert!(
            legs.clone().count() > 200 && legs.clone().all(|leg| leg.height_mm == Some(LAYER_MM))
        );
        let asked_mm3 = (extruded_mm + 2.0 * loading as f64) * FILAMENT_MM2;
        let volume_mm3 = program.volume_mm3().expect("extrusion");
        assert!(
            (volume_mm3 / asked_mm3 - 1.0).abs() < 1e-9,
            "{volume_mm3} {asked_mm3}"
        );
        let notes = program.notes.join("\n");
        let told: &[&str] = match printer {
            Printer::Changer => &["M201", "M203", "M106 P2 S0", "pushed out on the spot"],
            Printer::Klipper => &[
                "EXCLUDE_OBJECT_DEFINE",
                "PRINT_START",
                "SET_PRESSURE_ADVANCE",
            ],
        };
        for part in told {
            assert!(notes.contains(part), "{part}: {notes}");
        }
        let orders = program.heat.iter().map(|placed| placed.order.text());
        let orders = orders.collect::<Vec<String>>().join("; ");
        assert!(
            orders.contains("fan 40 %") && orders.contains("hot end 2"),
            "{orders}"
        );
        let plan = plan_gcode(&program, None, &Settings::default(), &()).expect("a plan");
        let worst_um = beside(&program, &plan).map(|mm| mm * 1e3);
        let share = plan.figures.volume_mm3 / volume_mm3 - 1.0;
        println!(
            "{worst_um:?} µm, volume {share:.1e}, {:.1} s",
            plan.figures.print_s
        );
        assert!(worst_um[0] < 20.0 && worst_um[1] < 50.0, "{worst_um:?}");
        assert!(share.abs() < 5e-3, "{share}");
        let run = dry_run(
            &plan.stream,
            &plan.settings,
            &SimulatorSetup::default(),
            |_| {},
        );
        let run = run.expect("a run");
        assert_eq!(
            (run.simulation.figures.faults, run.simulation.figures.holds),
            (0, 0)
        );
    }
}
