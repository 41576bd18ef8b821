mod hostile;
mod properties;
mod streams;
mod two_hosts;
