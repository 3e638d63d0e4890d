//! Checks a tree and converts it to a profile. Every key is checked, whatever is wrong with the others.

use crate::profile::keys::{similar_word, ProfileKey, DEVICE, FILE, POINT};
use crate::profile::model::{AddressBase, Device, KeyLines, Mistake, Point, Profile, Sentinel};
use crate::profile::point_address::{self, PointAddress};
use crate::profile::source_tree::{SourceEntry, SourceNode, SourceValue};
use crate::profile::types::{Access, Decimal, Order, Type};

/// The profile of a tree, as far as it can be understood. Mistakes are added to `mistakes`.
pub fn profile(tree: &SourceNode, mistakes: &mut Vec<Mistake>) -> Profile {
    let mut check = Checker { mistakes };
    if !matches!(tree.value, SourceValue::Map(_)) {
        check.report(tree.line, "", format!("a profile is a table, not {}", tree.kind()));
        return Profile::default();
    }
    check.known(tree, "", FILE.iter().copied());
    match tree.get("profile").map(|node| (&node.value, node)) {
        Some((SourceValue::Integer(1), _)) => {}
        Some((_, node)) => {
            check.report(node.line, "profile", format!("must be 1, the version of this format, not {}", node.shown()));
        }
        None => check.report(1, "profile", "is missing; the file begins with profile = 1".into()),
    }
    let device = tree.get("device").map_or_else(Device::default, |node| check.device(node));
    let mut points = Vec::new();
    match tree.get("registers").map(|node| (&node.value, node)) {
        Some((SourceValue::List(items), _)) => {
            points.extend(items.iter().enumerate().filter_map(|(i, node)| check.point(node, i, &device)));
        }
        Some((_, node)) => check.report(node.line, "registers", format!("takes a list of points, not {}", node.kind())),
        None => {}
    }
    Profile { device, points }
}

/// Collects the mistakes of one profile.
struct Checker<'m> {
    mistakes: &'m mut Vec<Mistake>,
}

/// A table of the file and the path to it.
struct Table<'t> {
    node: &'t SourceNode,
    path: String,
}

impl Table<'_> {
    /// The path of a key of this table: `registers[3].type`.
    fn path(&self, key: &str) -> String {
        format!("{}.{key}", self.path)
    }
}

impl Checker<'_> {
    fn report(&mut self, line: u32, key: &str, message: String) {
        self.mistakes.push(Mistake::new(line, key, message));
    }

    /// Reports keys that are not known, with a similar known key as a hint, and keys that occur twice.
    fn known<'a>(&mut self, node: &SourceNode, path: &str, known: impl Iterator<Item = &'a str> + Clone) {
        let mut seen: Vec<&str> = Vec::new();
        for entry in node.entries() {
            let key = if path.is_empty() { entry.key.clone() } else { format!("{path}.{}", entry.key) };
            if !known.clone().any(|name| name == entry.key) {
                let hint = similar_word(&entry.key, known.clone()).map(str::to_owned);
                let all = if hint.is_none() {
                    format!("; there are {}", known.clone().collect::<Vec<_>>().join(", "))
                } else {
                    String::new()
                };
                self.mistakes.push(Mistake { line: entry.line, key, message: format!("no such key{all}"), hint });
            } else if seen.contains(&entry.key.as_str()) {
                self.report(entry.line, &key, "appears twice".into());
            }
            seen.push(&entry.key);
        }
    }

    /// The table at this path, after its keys were checked; `None` if it is not a table.
    fn table<'t>(&mut self, node: &'t SourceNode, path: String, keys: &'static [ProfileKey]) -> Option<Table<'t>> {
        if !matches!(node.value, SourceValue::Map(_)) {
            self.report(node.line, &path, format!("takes a table, not {}", node.kind()));
            return None;
        }
        self.known(node, &path, keys.iter().map(|key| key.key));
        Some(Table { node, path })
    }

    /// The value of a key, converted by `read`. If that fails, its error is reported as a mistake.
    fn read<T>(&mut self, table: &Table<'_>, key: &str, read: impl FnOnce(&SourceNode) -> Result<T, String>) -> Option<T> {
        let node = table.node.get(key)?;
        match read(node) {
            Ok(value) => Some(value),
            Err(message) => {
                self.report(node.line, &table.path(key), message);
                None
            }
        }
    }

    /// The text of a key; numbers are accepted as text.
    fn text(&mut self, table: &Table<'_>, key: &str) -> Option<String> {
        self.read(table, key, |node| match &node.value {
            SourceValue::Text(text) => Ok(text.clone()),
            SourceValue::Integer(_) | SourceValue::Float(_) => Ok(node.shown()),
            _ => Err(format!("takes a text, not {}", node.kind())),
        })
    }

    /// The value of a key that takes one of some known words. Not case-sensitive.
    fn word<T: Copy>(&mut self, table: &Table<'_>, key: &str, known: &[(&'static str, T)]) -> Option<T> {
        let node = table.node.get(key)?;
        let text = if let SourceValue::Text(text) = &node.value { text.trim() } else { "" };
        let found = known.iter().find(|(word, _)| word.eq_ignore_ascii_case(text)).map(|(_, value)| *value);
        if found.is_none() {
            let words: Vec<&str> = known.iter().map(|(word, _)| *word).collect();
            let hint = similar_word(text, words.iter().copied()).filter(|_| words.len() > 4).map(str::to_owned);
            let message = format!("{} is not one of {}", node.shown(), words.join(", "));
            self.mistakes.push(Mistake { line: node.line, key: table.path(key), message, hint });
        }
        found
    }

    fn order(&mut self, table: &Table<'_>) -> Option<Order> {
        self.word(table, "order", &Order::ALL.map(|(order, word)| (word, order)))
    }

    /// Checks the table `[device]`.
    fn device(&mut self, node: &SourceNode) -> Device {
        let Some(table) = self.table(node, "device".into(), DEVICE) else { return Device::default() };
        let codes = |node: &SourceNode| {
            list(node, |item| match item.value {
                SourceValue::Integer(code @ 1..=127) => Ok(code as u8),
                _ => Err(format!("takes function codes from 1 to 127, not {}", item.shown())),
            })
        };
        let names = |node: &SourceNode| {
            list(node, |item| match &item.value {
                SourceValue::Text(text) => Ok(text.clone()),
                _ => Err(format!("takes a list of names, not {}", item.shown())),
            })
        };
        let exceptions = self.labels(&table, "exceptions", 1, 255);
        Device {
            id: self.text(&table, "id"),
            vendor: self.text(&table, "vendor"),
            model: self.text(&table, "model"),
            source: self.text(&table, "source"),
            note: self.text(&table, "note"),
            address_base: self.read(&table, "address_base", base).unwrap_or_default(),
            order: self.order(&table).unwrap_or_default(),
            functions: self.read(&table, "functions", codes).unwrap_or_default(),
            exceptions: exceptions.into_iter().map(|(code, text)| (code as u8, text)).collect(),
            vendor_functions: self.read(&table, "vendor_functions", names).unwrap_or_default(),
            sunspec: self.read(&table, "sunspec", whole),
        }
    }

    /// Checks one point of `[[registers]]`. `None` if it has no usable address or name.
    fn point(&mut self, node: &SourceNode, index: usize, device: &Device) -> Option<Point> {
        let table = self.table(node, format!("registers[{index}]"), POINT)?;
        for key in ["at", "name"] {
            if node.get(key).is_none() {
                self.report(node.line, &table.path(key), "is missing; every point needs at and name".into());
            }
        }
        let at = self.read(&table, "at", |node| match &node.value {
            SourceValue::Text(text) => point_address::parse(text, device.address_base),
            _ => Err(format!("takes a text such as \"hr:0x00CD\", not {}", node.shown())),
        });
        let name = self.text(&table, "name").filter(|name| {
            let good = !name.trim().is_empty();
            if !good {
                self.report(line_of(node, "name"), &table.path("name"), "is empty".into());
            }
            good
        });
        let kind = self.word(&table, "type", &Type::ALL.map(|row| (row.1, row.0)));
        let is_type_wrong = kind.is_none() && node.get("type").is_some();
        let count = self.read(&table, "count", whole);
        let order = self.order(&table).unwrap_or(device.order);
        let scale = self.read(&table, "scale", decimal).filter(|scale| {
            if scale.digits == 0 {
                self.report(line_of(node, "scale"), &table.path("scale"), "is 0: every value would be the same".into());
            }
            scale.digits != 0
        });
        let offset = self.read(&table, "offset", decimal);
        let access = self.word(&table, "access", &Access::ALL.map(|(access, word)| (word, access)));
        let labels = self.labels(&table, "enum", i64::MIN, i64::MAX);
        let bit_labels = self.labels(&table, "bits", 0, 63);
        let nan = self.read(&table, "nan", |node| list(node, sentinel)).unwrap_or_default();
        let (sf, unit) = (self.text(&table, "sf"), self.text(&table, "unit"));
        let words = [self.text(&table, "group"), self.text(&table, "note")];
        let PointAddress { space, address, bits } = at?;
        let single = space.is_bits() || bits.is_some_and(|(first, last)| first == last);
        let kind = kind.unwrap_or(if single { Type::Bool } else { Type::U16 });
        let type_registers = kind.registers();
        let point = Point {
            space,
            address,
            bits,
            name: name?,
            kind,
            count: count.unwrap_or(type_registers.max(1)),
            order,
            scale,
            offset,
            sf,
            unit,
            access: access.unwrap_or_default(),
            labels,
            bit_labels: bit_labels.into_iter().map(|(bit, text)| (bit as u8, text)).collect(),
            nan,
            group: words[0].clone(),
            note: words[1].clone(),
            scope: 0,
            lines: KeyLines { index, at: line_of(node, "at"), name: line_of(node, "name"), sf: line_of(node, "sf") },
        };
        if !is_type_wrong {
            self.check_consistency(&table, &point, count);
        }
        Some(point)
    }

    /// Reports keys that contradict the type of a point or each other. `count` is the value in the file, if there is
    /// one.
    fn check_consistency(&mut self, table: &Table<'_>, point: &Point, count: Option<u16>) {
        let (kind, word, type_registers) = (point.kind, point.kind.word(), point.kind.registers());
        let mut report_key = |key: &str, message: String| self.report(line_of(table.node, key), &table.path(key), message);
        match count {
            None if type_registers == 0 => report_key("type", format!("{word} needs count, the number of its registers")),
            Some(count) if type_registers > 1 && !count.is_multiple_of(type_registers) => {
                report_key("count", format!("{count} registers, but each {word} takes {type_registers}"));
            }
            Some(count) if count > 1 && point.bits.is_some() => report_key("count", "a part of a register has no count".into()),
            _ => {}
        }
        if u32::from(point.address) + u32::from(point.count) > 0x1_0000 {
            report_key("at", format!("{} from wire address {} on reach beyond 65535", point.count, point.address));
        }
        if point.space.is_bits() && kind != Type::Bool {
            report_key("type", format!("{word}, but a {} is a bool", point.space.long_name().replace('_', " ")));
        } else if kind == Type::Bool && !point.space.is_bits() && point.bits.is_none_or(|(first, last)| first != last) {
            report_key("type", "bool takes one bit: at = \"hr:10.3\"".into());
        } else if point.bits.is_some() && !matches!(kind, Type::Bool | Type::U16 | Type::S16) {
            report_key("type", format!("{word}, but a part of a register is bool, u16 or s16"));
        }
        for key in ["scale", "offset", "sf"] {
            if table.node.get(key).is_some() && !kind.is_number() {
                report_key(key, format!("a {word} is not a number, so it cannot be scaled"));
            }
        }
        let labelled = kind.is_integer() || kind == Type::Bool;
        if !point.labels.is_empty() && !labelled {
            report_key("enum", format!("a {word} is not a whole number, so it cannot have labels"));
        }
        if let Some((bit, _)) = point.bit_labels.iter().find(|(bit, _)| u32::from(*bit) >= kind.bits().max(1)) {
            report_key("bits", format!("bit {bit}, but a {word} has bits 0 to {}", kind.bits().max(1) - 1));
        }
        if point.nan.iter().any(|nan| matches!(nan, Sentinel::Float(_))) && kind.is_integer() {
            report_key("nan", format!("a {word} is a whole number; raw values that mean no value are, too"));
        }
        if !point.nan.is_empty() && !kind.is_number() {
            report_key("nan", format!("a {word} is not a number"));
        }
    }

    /// The labels of a table number -> text, with numbers from `low` to `high`, sorted by number.
    fn labels(&mut self, table: &Table<'_>, key: &str, low: i64, high: i64) -> Vec<(i64, String)> {
        let Some(node) = table.node.get(key) else { return Vec::new() };
        let SourceValue::Map(entries) = &node.value else {
            self.report(node.line, &table.path(key), format!("takes a table of number = \"label\", not {}", node.kind()));
            return Vec::new();
        };
        let mut found = Vec::new();
        for entry in entries {
            match label(entry, low, high) {
                Ok(pair) => found.push(pair),
                Err(message) => self.report(entry.line, &format!("{}.{}", table.path(key), entry.key), message),
            }
        }
        found.sort_by_key(|(number, _)| *number);
        found
    }
}

/// The line of a key, or of its table if the key is absent.
fn line_of(node: &SourceNode, key: &str) -> u32 {
    node.get(key).map_or(node.line, |node| node.line)
}

/// One entry of a table of labels.
fn label(entry: &SourceEntry, low: i64, high: i64) -> Result<(i64, String), String> {
    let text = entry.key.trim();
    let number = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    };
    let number = number.ok_or_else(|| format!("{text:?} is not a number"))?;
    if !(low..=high).contains(&number) {
        return Err(format!("{number} is not from {low} to {high}"));
    }
    match &entry.node.value {
        SourceValue::Text(label) => Ok((number, label.clone())),
        SourceValue::Integer(_) | SourceValue::Float(_) | SourceValue::Bool(_) => Ok((number, entry.node.shown())),
        _ => Err(format!("takes a text, not {}", entry.node.kind())),
    }
}

/// Converts the items of a list; a single value counts as a list of one.
fn list<T>(node: &SourceNode, read: impl Fn(&SourceNode) -> Result<T, String>) -> Result<Vec<T>, String> {
    match &node.value {
        SourceValue::List(items) => items.iter().map(read).collect(),
        _ => Ok(vec![read(node)?]),
    }
}

/// An integer from 1 to 65535.
fn whole(node: &SourceNode) -> Result<u16, String> {
    match node.value {
        SourceValue::Integer(number @ 1..=0xFFFF) => Ok(number as u16),
        _ => Err(format!("takes a whole number from 1 on, not {}", node.shown())),
    }
}

/// A decimal number, kept exactly.
fn decimal(node: &SourceNode) -> Result<Decimal, String> {
    let text = match &node.value {
        SourceValue::Integer(_) | SourceValue::Float(_) => node.shown(),
        _ => return Err(format!("takes a number, not {}", node.shown())),
    };
    Decimal::parse(&text).ok_or_else(|| format!("takes a number of at most 18 digits, not {text}"))
}

/// A raw value that means "no value".
fn sentinel(node: &SourceNode) -> Result<Sentinel, String> {
    match &node.value {
        SourceValue::Integer(number) => Ok(Sentinel::Whole(*number)),
        SourceValue::Float(text) => text.parse().map(Sentinel::Float).map_err(|_| format!("{text} is not a number")),
        _ => Err(format!("takes a raw value or a list of them, not {}", node.shown())),
    }
}

/// The way in which a file counts addresses.
fn base(node: &SourceNode) -> Result<AddressBase, String> {
    match &node.value {
        SourceValue::Integer(0) => Ok(AddressBase::Zero),
        SourceValue::Integer(1) => Ok(AddressBase::One),
        SourceValue::Text(text) if text.eq_ignore_ascii_case("modicon") => Ok(AddressBase::Modicon),
        _ => Err(format!("must be 0, 1 or \"modicon\", not {}", node.shown())),
    }
}
