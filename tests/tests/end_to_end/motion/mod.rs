mod bed_mesh;
mod limits;
mod steps;
