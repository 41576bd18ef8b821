mod export;
mod heat_orders;
mod orca;
mod reading;
