mod drivers;
mod emulated;
mod figures;
mod thermal;
