//! The field layout of a PDU body, and how the length of a body follows from its first bytes.

/// The type of one field of a body, with the spellings used in `functions.toml`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FieldType {
    /// One byte.
    U8,
    /// Two bytes, high byte first.
    U16,
    /// One byte: the number of bytes that follow to the end of the body.
    Len8,
    /// Two bytes: the number of bytes that follow to the end of the body.
    Len16,
    /// One byte: the number of items in the next list.
    Count8,
    /// Two bytes: the number of items in the next list.
    Count16,
    /// Packed bits, least significant bit first.
    Bits,
    /// A list of one-byte numbers.
    U8List,
    /// A list of two-byte numbers, high byte first.
    U16List,
    /// Text or binary data.
    Bytes,
    /// A list of groups, each with these fields.
    Group(Vec<Field>),
}

impl FieldType {
    /// Size in bytes of a number, length or count; 0 for a list, whose size varies.
    pub fn width(&self) -> usize {
        match self {
            Self::U8 | Self::Len8 | Self::Count8 => 1,
            Self::U16 | Self::Len16 | Self::Count16 => 2,
            _ => 0,
        }
    }

    /// The spelling in the table of functions.
    pub fn spelling(&self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::Len8 => "len8",
            Self::Len16 => "len16",
            Self::Count8 => "count8",
            Self::Count16 => "count16",
            Self::Bits => "bits",
            Self::U8List => "u8[]",
            Self::U16List => "u16[]",
            Self::Bytes => "bytes",
            Self::Group(_) => "group",
        }
    }
}

/// One field of a body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name, as columns and `modlens show` print it.
    pub name: String,
    /// Its type on the wire.
    pub field_type: FieldType,
}

/// The length of a body, as far as its first bytes determine it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// The body has exactly this many bytes.
    Exactly(usize),
    /// The body has at least this many bytes, more than there are; with that many, the length can be determined.
    AtLeast(usize),
    /// The body has at least this many bytes, and no field gives its length: only the checksum or a silence ends it.
    Open(usize),
}

/// How `Shape::extent` finds the length. Nearly all functions need no walk through their fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LengthRule {
    /// The length is constant.
    Fixed(usize),
    /// The only variable part is announced by the length byte at this offset.
    LengthAt(usize),
    /// The fields have to be read one after the other.
    Walk,
}

/// The fields of a body, in wire order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    /// The fields, in wire order.
    pub fields: Vec<Field>,
    length_rule: LengthRule,
}

impl Shape {
    /// Builds a shape and chooses the fastest way to determine the length of its bodies.
    pub(super) fn new(fields: Vec<Field>) -> Self {
        let mut fixed_bytes = 0;
        let mut length_rule = None;
        for field in &fields {
            match field.field_type {
                FieldType::U8 | FieldType::U16 => fixed_bytes += field.field_type.width(),
                FieldType::Len8 => {
                    length_rule = Some(LengthRule::LengthAt(fixed_bytes));
                    break;
                }
                _ => {
                    length_rule = Some(LengthRule::Walk);
                    break;
                }
            }
        }
        Self { length_rule: length_rule.unwrap_or(LengthRule::Fixed(fixed_bytes)), fields }
    }

    /// The length of a body that starts with these bytes.
    #[inline]
    pub fn extent(&self, body: &[u8]) -> Extent {
        match self.length_rule {
            LengthRule::Fixed(length) => Extent::Exactly(length),
            LengthRule::LengthAt(at) => match body.get(at) {
                Some(&length) => Extent::Exactly(at + 1 + length as usize),
                None => Extent::AtLeast(at + 1),
            },
            LengthRule::Walk => walk(&self.fields, body),
        }
    }

    /// Whether a body of exactly these bytes can have this shape.
    pub fn fits(&self, body: &[u8]) -> bool {
        match self.extent(body) {
            Extent::Exactly(length) => length == body.len(),
            Extent::Open(least) => body.len() >= least,
            Extent::AtLeast(_) => false,
        }
    }

    /// Whether the repeated groups at the end of a body (file records, for example) end exactly at the end of the body.
    /// True for shapes without groups.
    pub fn groups_fit(&self, body: &[u8]) -> bool {
        let Some(Field { field_type: FieldType::Group(inner), .. }) = self.fields.last() else { return true };
        let mut offset = self.fields[..self.fields.len() - 1].iter().map(|field| field.field_type.width()).sum::<usize>();
        while offset < body.len() {
            match walk(inner, &body[offset..]) {
                Extent::Exactly(length) if length > 0 => offset += length,
                _ => return false,
            }
        }
        offset == body.len()
    }

    /// The body offset of a numeric field that is before all fields of variable length, and so has a fixed offset.
    pub fn offset_of(&self, name: &str) -> Option<usize> {
        let mut offset = 0;
        for field in &self.fields {
            let width = field.field_type.width();
            if width == 0 {
                return None;
            }
            if field.name == name {
                return Some(offset);
            }
            offset += width;
        }
        None
    }

    /// Offset and size in bytes of a numeric field with a fixed place: before all fields of variable length, or in the
    /// first of the repeated groups that follow them.
    pub fn place_of(&self, name: &str) -> Option<(usize, usize)> {
        let width_of = |fields: &[Field]| {
            fields.iter().find(|field| field.name == name && field.field_type.width() > 0).map(|f| f.field_type.width())
        };
        if let Some(offset) = self.offset_of(name) {
            return Some((offset, width_of(&self.fields)?));
        }
        let Some(Field { field_type: FieldType::Group(inner), .. }) = self.fields.last() else { return None };
        let fixed_bytes: usize = self.fields[..self.fields.len() - 1].iter().map(|field| field.field_type.width()).sum();
        let group = Self::new(inner.clone());
        Some((fixed_bytes + group.offset_of(name)?, width_of(inner)?))
    }

    /// The list of registers or bits in the body: (offset, whether it is packed bits).
    pub fn block(&self) -> Option<(usize, bool)> {
        let mut offset = 0;
        for field in &self.fields {
            match field.field_type {
                FieldType::Bits => return Some((offset, true)),
                FieldType::U16List => return Some((offset, false)),
                _ => {}
            }
            let width = field.field_type.width();
            if width == 0 {
                return None;
            }
            offset += width;
        }
        None
    }
}

/// The big-endian number of `width` (1 or 2) bytes at an offset; `None` if the body ends before.
pub(crate) fn number(body: &[u8], at: usize, width: usize) -> Option<usize> {
    match width {
        1 => body.get(at).map(|&b| b as usize),
        _ => Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]) as usize),
    }
}

/// Determines the length of a body by reading its lengths and counts field by field.
///
/// A length field covers the rest of the body, so the walk ends there. A list without a preceding count or length has
/// no known end.
fn walk(fields: &[Field], body: &[u8]) -> Extent {
    let mut offset = 0;
    let mut count = None;
    for field in fields {
        let width = field.field_type.width();
        if width > 0 {
            let Some(value) = number(body, offset, width) else {
                return Extent::AtLeast(offset + width);
            };
            offset += width;
            match field.field_type {
                FieldType::Len8 | FieldType::Len16 => return Extent::Exactly(offset + value),
                FieldType::Count8 | FieldType::Count16 => count = Some(value),
                _ => {}
            }
            continue;
        }
        let Some(items) = count.take() else {
            return Extent::Open(offset);
        };
        match &field.field_type {
            FieldType::U16List => offset += 2 * items,
            FieldType::Bits => offset += items.div_ceil(8),
            FieldType::Group(inner) => {
                for _ in 0..items {
                    match walk(inner, body.get(offset..).unwrap_or(&[])) {
                        Extent::Exactly(length) => offset += length,
                        Extent::AtLeast(length) => return Extent::AtLeast(offset + length),
                        Extent::Open(length) => return Extent::Open(offset + length),
                    }
                }
            }
            _ => offset += items,
        }
    }
    Extent::Exactly(offset)
}

/// What is known about the body of a function in one direction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The layout is not public (reserved or vendor-specific function without a row).
    Unknown,
    /// The request is not answered, so there is no body.
    NoResponse,
    /// The body has these fields.
    Body(Shape),
}

impl Layout {
    /// The fields, if they are known.
    pub fn shape(&self) -> Option<&Shape> {
        match self {
            Self::Body(shape) => Some(shape),
            _ => None,
        }
    }

    /// The length of a body that starts with these bytes; unbounded if the layout is not known.
    #[inline]
    pub fn extent(&self, body: &[u8]) -> Extent {
        match self {
            Self::Body(shape) => shape.extent(body),
            _ => Extent::Open(0),
        }
    }

    /// Whether a body of exactly these bytes can have this layout. An unknown layout accepts any body.
    pub fn fits(&self, body: &[u8]) -> bool {
        match self {
            Self::Body(shape) => shape.fits(body),
            Self::Unknown => true,
            Self::NoResponse => false,
        }
    }
}
