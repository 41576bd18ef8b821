//! Sizes and symbols of a controller's ELF file: 32 bits, little endian.
//!
//! Source: Tool Interface Standard, ELF Specification 1.2. No more of it than the figures need.

use std::path::Path;

/// Section header fields that matter.
#[derive(Clone, Copy, Debug)]
struct Section {
    kind: u32,
    flags: u32,
    address: u32,
    offset: usize,
    size: usize,
    link: usize,
}

const KIND_SYMBOLS: u32 = 2;
const KIND_NO_BITS: u32 = 8;
const FLAG_WRITE: u32 = 1;
const FLAG_ALLOCATED: u32 = 2;
/// Bytes of a symbol's entry.
const SYMBOL_BYTES: usize = 16;
/// Parts of names of functions that only a panic needs.
const PANIC_NAMES: [&str; 7] = [
    "panicking",
    "panic_fmt",
    "panic_bounds_check",
    "slice_index",
    "unwrap_failed",
    "expect_failed",
    "rust_begin_unwind",
];
/// Parts of names of functions that turn floating-point numbers into text.
const FLOAT_TEXT_NAMES: [&str; 4] = [
    "flt2dec",
    "float_to_decimal",
    "float_to_exponential",
    "fmt5float",
];
/// Parts of names of an allocator.
const HEAP_NAMES: [&str; 3] = ["__rust_alloc", "__rg_alloc", "alloc_error"];

/// What a flasher writes: bytes of the file and the place in memory that it loads them to.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// First address.
    pub address: u32,
    /// Bytes in the file.
    pub bytes: u32,
    offset: usize,
}

/// Kind of a program header whose bytes are loaded.
const SEGMENT_LOADED: u32 = 1;

/// A file, read.
#[derive(Debug)]
pub struct Elf {
    bytes: Vec<u8>,
    segments: Vec<Segment>,
    sections: Vec<Section>,
    symbols: Vec<(String, u32)>,
}

impl Elf {
    /// Reads a file.
    ///
    /// # Errors
    /// Text of what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, String> {
        let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
        Self::parse(&bytes).ok_or_else(|| format!("{} is no 32-bit ELF file", path.display()))
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let half = |at: usize| Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?));
        let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
        if bytes.get(..6)? != b"\x7fELF\x01\x01" {
            return None;
        }
        let (start, size, count) = (word(32)? as usize, half(46)? as usize, half(48)? as usize);
        let mut sections = Vec::new();
        for index in 0..count {
            let at = start + index * size;
            sections.push(Section {
                kind: word(at + 4)?,
                flags: word(at + 8)?,
                address: word(at + 12)?,
                offset: word(at + 16)? as usize,
                size: word(at + 20)? as usize,
                link: word(at + 24)? as usize,
            });
        }
        let segments = (0..half(44)? as usize)
            .map(|index| {
                let at = word(28)? as usize + index * half(42)? as usize;
                Some((
                    word(at)?,
                    Segment {
                        address: word(at + 12)?,
                        bytes: word(at + 16)?,
                        offset: word(at + 4)? as usize,
                    },
                ))
            })
            .collect::<Option<Vec<_>>>()?;
        let loaded =
            |(kind, segment): &(u32, Segment)| *kind == SEGMENT_LOADED && segment.bytes > 0;
        let segments = segments.into_iter().filter(loaded);
        let mut symbols = Vec::new();
        for section in sections
            .iter()
            .filter(|section| section.kind == KIND_SYMBOLS)
        {
            let names = sections.get(section.link)?;
            for index in 0..section.size / SYMBOL_BYTES {
                let name = word(section.offset + index * SYMBOL_BYTES)? as usize;
                let text = bytes
                    .get(names.offset + name..)?
                    .split(|&byte| byte == 0)
                    .next()?;
                let name = String::from_utf8_lossy(text).into_owned();
                symbols.push((name, word(section.offset + index * SYMBOL_BYTES + 4)?));
            }
        }
        Some(Self {
            bytes: bytes.to_vec(),
            segments: segments.map(|(_, segment)| segment).collect(),
            sections,
            symbols,
        })
    }

    /// What a flasher writes.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// The flash from its first byte to its last, as `objcopy -O binary` writes it: gaps are zero. With
    /// the address of the first byte.
    pub fn image(&self) -> (u32, Vec<u8>) {
        let first = self.segments.iter().map(|segment| segment.address).min();
        let first = first.unwrap_or(0);
        let mut image = Vec::new();
        for segment in &self.segments {
            let at = (segment.address - first) as usize;
            let end = at + segment.bytes as usize;
            image.resize(image.len().max(end), 0);
            let file = &self.bytes[segment.offset..segment.offset + segment.bytes as usize];
            image[at..end].copy_from_slice(file);
        }
        (first, image)
    }

    fn allocated(&self) -> impl Iterator<Item = &Section> {
        let allocated = |section: &&Section| section.flags & FLAG_ALLOCATED != 0;
        self.sections.iter().filter(allocated)
    }

    /// Static RAM: initialised data and what begins as zero.
    pub fn ram_bytes(&self) -> usize {
        let in_ram =
            |section: &&Section| section.flags & FLAG_WRITE != 0 && section.address >= 0x2000_0000;
        self.allocated()
            .filter(in_ram)
            .map(|section| section.size)
            .sum()
    }

    /// What is written to flash.
    pub fn flash_bytes(&self) -> usize {
        let written = |section: &&Section| section.kind != KIND_NO_BITS;
        self.allocated()
            .filter(written)
            .map(|section| section.size)
            .sum()
    }

    fn named(&self, parts: &[&str]) -> Vec<&str> {
        let symbols = self.symbols.iter().map(|(name, _)| name.as_str());
        symbols
            .filter(|name| parts.iter().any(|part| name.contains(part)))
            .collect()
    }

    /// Address of the one symbol whose name has this part; of several, the one that is shortest.
    pub fn address_of(&self, part: &str) -> Option<u32> {
        let named = self.symbols.iter().filter(|(name, _)| name.contains(part));
        let shortest = named.min_by_key(|(name, _)| name.len());
        shortest.map(|(_, address)| *address)
    }

    /// Functions that only a panic needs.
    pub fn panic_symbols(&self) -> Vec<&str> {
        self.named(&PANIC_NAMES)
    }

    /// Functions that turn floating-point numbers into text, or allocate.
    pub fn forbidden_symbols(&self) -> Vec<&str> {
        let mut found = self.named(&FLOAT_TEXT_NAMES);
        found.extend(self.named(&HEAP_NAMES));
        found
    }
}
