mod meshes;
mod mutated_files;
mod nurbs;
mod outlines;
mod progress;
