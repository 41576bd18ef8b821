//! Headings that fit, against brute force; the medial axis and what is reachable.

mod apertures;
mod dense_search;
mod heading_stops;
mod medial_axis_oracle;
mod noisy_headings;
mod polygon_headings;
mod reachable_oracle;
mod stops_of_files;
mod table_oracle;
