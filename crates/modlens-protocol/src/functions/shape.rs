//! Shapes: the fields of a body and how long it is.

/// What one field of a body is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Word {
    /// One byte.
    U8,
    /// Two bytes, high byte first.
    U16,
    /// One byte: how many bytes follow.
    Len8,
    /// Two bytes: how many bytes follow.
    Len16,
    /// One byte: how many items the next list has.
    Count8,
    /// Two bytes: how many items the next list has.
    Count16,
    /// Packed bits, lowest first.
    Bits,
    /// Numbers of one byte.
    U8List,
    /// Numbers of two bytes.
    U16List,
    /// Text or binary.
    Bytes,
    /// Groups of fields.
    Group(Vec<Field>),
}

impl Word {
    /// Bytes of a number or length; 0 for lists.
    pub fn width(&self) -> usize {
        match self {
            Self::U8 | Self::Len8 | Self::Count8 => 1,
            Self::U16 | Self::Len16 | Self::Count16 => 2,
            _ => 0,
        }
    }

    /// The word as the table spells it.
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

/// One field: its name and word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name, as columns and `show` print it.
    pub name: String,
    /// What stands on the wire.
    pub word: Word,
}

/// How long a body is, as far as its first bytes tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// So many bytes.
    Exactly(usize),
    /// At least so many; more bytes will tell.
    AtLeast(usize),
    /// At least so many; the layout does not say how many. Only checksum or silence end it.
    Open(usize),
}

/// The shortcut that `Shape::extent` takes for nearly every function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plan {
    Fixed(usize),
    LengthAt(usize),
    Walk,
}

/// The fields of a body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Fields in wire order.
    pub fields: Vec<Field>,
    plan: Plan,
}

impl Shape {
    pub(super) fn new(fields: Vec<Field>) -> Self {
        let mut fixed = 0;
        let mut plan = None;
        for field in &fields {
            match field.word {
                Word::U8 | Word::U16 => fixed += field.word.width(),
                Word::Len8 => {
                    plan = Some(Plan::LengthAt(fixed));
                    break;
                }
                _ => {
                    plan = Some(Plan::Walk);
                    break;
                }
            }
        }
        Self { plan: plan.unwrap_or(Plan::Fixed(fixed)), fields }
    }

    /// The length of a body that starts with these bytes.
    #[inline]
    pub fn extent(&self, body: &[u8]) -> Extent {
        match self.plan {
            Plan::Fixed(length) => Extent::Exactly(length),
            Plan::LengthAt(at) => match body.get(at) {
                Some(&length) => Extent::Exactly(at + 1 + length as usize),
                None => Extent::AtLeast(at + 1),
            },
            Plan::Walk => walk(&self.fields, body),
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

    /// Whether the groups of a body, if it has any, fill it without rest.
    pub fn groups_fit(&self, body: &[u8]) -> bool {
        let Some(Field { word: Word::Group(inner), .. }) = self.fields.last() else { return true };
        let mut rest = self.fields[..self.fields.len() - 1].iter().map(|field| field.word.width()).sum::<usize>();
        while rest < body.len() {
            match walk(inner, &body[rest..]) {
                Extent::Exactly(length) if length > 0 => rest += length,
                _ => return false,
            }
        }
        rest == body.len()
    }

    /// The body offset of a number that stands before everything of variable length.
    pub fn offset_of(&self, name: &str) -> Option<usize> {
        let mut offset = 0;
        for field in &self.fields {
            let width = field.word.width();
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

    /// Body offset and width of a number that has a fixed place: before everything of variable length, or in the first
    /// group behind that.
    pub fn place_of(&self, name: &str) -> Option<(usize, usize)> {
        let named =
            |fields: &[Field]| fields.iter().find(|field| field.name == name && field.word.width() > 0).map(|f| f.word.width());
        if let Some(offset) = self.offset_of(name) {
            return Some((offset, named(&self.fields)?));
        }
        let Some(Field { word: Word::Group(inner), .. }) = self.fields.last() else { return None };
        let before: usize = self.fields[..self.fields.len() - 1].iter().map(|field| field.word.width()).sum();
        let group = Self::new(inner.clone());
        Some((before + group.offset_of(name)?, named(inner)?))
    }

    /// The list that holds registers or bits: (body offset, whether it is bits).
    pub fn block(&self) -> Option<(usize, bool)> {
        let mut offset = 0;
        for field in &self.fields {
            match field.word {
                Word::Bits => return Some((offset, true)),
                Word::U16List => return Some((offset, false)),
                _ => {}
            }
            let width = field.word.width();
            if width == 0 {
                return None;
            }
            offset += width;
        }
        None
    }
}

pub(crate) fn number(body: &[u8], at: usize, width: usize) -> Option<usize> {
    match width {
        1 => body.get(at).map(|&b| b as usize),
        _ => Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]) as usize),
    }
}

fn walk(fields: &[Field], body: &[u8]) -> Extent {
    let mut at = 0;
    let mut count = None;
    for field in fields {
        let width = field.word.width();
        if width > 0 {
            let Some(value) = number(body, at, width) else {
                return Extent::AtLeast(at + width);
            };
            at += width;
            match field.word {
                Word::Len8 | Word::Len16 => return Extent::Exactly(at + value),
                Word::Count8 | Word::Count16 => count = Some(value),
                _ => {}
            }
            continue;
        }
        let Some(items) = count.take() else {
            return Extent::Open(at);
        };
        match &field.word {
            Word::U16List => at += 2 * items,
            Word::Bits => at += items.div_ceil(8),
            Word::Group(inner) => {
                for _ in 0..items {
                    match walk(inner, body.get(at..).unwrap_or(&[])) {
                        Extent::Exactly(length) => at += length,
                        Extent::AtLeast(length) => return Extent::AtLeast(at + length),
                        Extent::Open(length) => return Extent::Open(at + length),
                    }
                }
            }
            _ => at += items,
        }
    }
    Extent::Exactly(at)
}

/// What is known of one direction of a function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The layout is not public.
    Unknown,
    /// There is none: the request is not answered.
    Silent,
    /// The fields.
    Body(Shape),
}

impl Layout {
    /// The shape, where there is one.
    pub fn shape(&self) -> Option<&Shape> {
        match self {
            Self::Body(shape) => Some(shape),
            _ => None,
        }
    }

    /// The length of a body that starts with these bytes.
    pub fn extent(&self, body: &[u8]) -> Extent {
        match self {
            Self::Body(shape) => shape.extent(body),
            _ => Extent::Open(0),
        }
    }

    /// Whether a body of exactly these bytes can have this layout; an unknown one takes any.
    pub fn fits(&self, body: &[u8]) -> bool {
        match self {
            Self::Body(shape) => shape.fits(body),
            Self::Unknown => true,
            Self::Silent => false,
        }
    }
}
