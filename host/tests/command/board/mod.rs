mod calibrate;
mod live;
mod orders;
mod probe;
mod registers;
mod resume;
mod stream;
