mod device_check;
mod drivers;
mod emulated;
mod figures;
mod thermal;
