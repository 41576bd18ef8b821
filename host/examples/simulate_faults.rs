//! Plans an outline from SVG and simulates it over a line that loses and flips bytes.
//!
//! `cargo run --example simulate_faults`

use headway::api::{Error, Machine, Options, Part, Reading, plan};

const SVG: &str = r#"<svg xmlns="http://www.w3.org/2000/svg" width="10mm" height="6mm" viewBox="0 0 10 6">
  <path d="M0 0H10V2H2V6H0Z"/></svg>"#;

/// Plans and simulates; the digest of all steps, without faults and with.
pub fn run() -> Result<[String; 2], Error> {
    let part = Part::from_bytes("angle", "svg", SVG.as_bytes(), &Reading::default())?;
    let job = plan(&part, &Machine::default(), &Options::default())?;
    let digest = |link: &str| {
        let simulation = job.simulate(link, 7)?;
        simulation.check()?;
        let resent = simulation.figure("resent_frames").unwrap_or_default();
        let error_um = simulation.figure("tip_error_um_max").unwrap_or_default();
        println!("link `{link}`: {resent} frames sent again, tip within {error_um:.1} um");
        let figures: serde_json::Value = serde_json::from_str(&simulation.figures_json())
            .map_err(|error| Error::Job(error.to_string()))?;
        Ok::<_, Error>(figures["step_digest"].to_string())
    };
    Ok([digest("")?, digest("drop=0.02,flip=1e-4")?])
}

#[allow(dead_code)]
fn main() -> Result<(), Error> {
    let [clean, faulty] = run()?;
    println!("the same steps: {}", clean == faulty);
    Ok(())
}
