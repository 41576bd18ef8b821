mod hostile;
mod properties;
mod streams;
