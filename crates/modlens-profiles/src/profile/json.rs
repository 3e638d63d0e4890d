//! A profile as JSON with wire addresses, as exporters, views and profile matching use it.

use serde_json::{json, Map, Value as Json};

use crate::profile::model::{Device, Point, Profile, Sentinel};
use crate::profile::types::{Access, Order};

/// The profile as plain JSON with the keys of the file format and with addresses as on the wire. It can be parsed
/// again.
pub fn to_json(profile: &Profile) -> Json {
    json!({
        "profile": 1,
        "device": device(&profile.device),
        "registers": profile.points.iter().map(|point| self::point(point, profile.device.order)).collect::<Vec<_>>(),
    })
}

/// Adds a key, if it has a value.
fn put(map: &mut Map<String, Json>, key: &str, value: Option<impl Into<Json>>) {
    if let Some(value) = value {
        map.insert(key.into(), value.into());
    }
}

/// The table `[device]`. Keys with their default value are left out.
fn device(device: &Device) -> Json {
    let mut map = Map::new();
    for (key, text) in [
        ("id", &device.id),
        ("vendor", &device.vendor),
        ("model", &device.model),
        ("source", &device.source),
        ("note", &device.note),
    ] {
        put(&mut map, key, text.clone());
    }
    // The points below have wire addresses.
    map.insert("address_base".into(), 0.into());
    put(&mut map, "order", Some(device.order.word()).filter(|_| device.order != Order::default()));
    put(&mut map, "functions", Some(device.functions.clone()).filter(|codes| !codes.is_empty()));
    put(&mut map, "vendor_functions", Some(device.vendor_functions.clone()).filter(|names| !names.is_empty()));
    put(&mut map, "sunspec", device.sunspec);
    let words: Map<String, Json> =
        device.exceptions.iter().map(|(code, text)| (format!("0x{code:02X}"), text.clone().into())).collect();
    put(&mut map, "exceptions", Some(words).filter(|words| !words.is_empty()));
    Json::Object(map)
}

/// One of `[[registers]]`. Keys with their default value are left out; `default` is the order of the device.
fn point(point: &Point, default: Order) -> Json {
    let mut map = Map::new();
    let bits = match point.bits {
        None => String::new(),
        Some((first, last)) if first == last => format!(".{first}"),
        Some((first, last)) => format!(".{first}-{last}"),
    };
    map.insert("at".into(), format!("{}:{}{bits}", point.space.short_name(), point.address).into());
    map.insert("name".into(), point.name.clone().into());
    map.insert("type".into(), point.kind.word().into());
    let own = point.kind.registers().max(1);
    put(&mut map, "count", Some(point.count).filter(|&count| count != own || point.kind.registers() == 0));
    put(&mut map, "order", Some(point.order.word()).filter(|_| point.order != default));
    for (key, number) in [("scale", point.scale), ("offset", point.offset)] {
        put(&mut map, key, number.map(|number| number.to_string().parse::<Json>().unwrap_or(Json::Null)));
    }
    put(&mut map, "sf", point.sf.clone());
    put(&mut map, "unit", point.unit.clone());
    put(&mut map, "access", Some(point.access.word()).filter(|_| point.access != Access::default()));
    let labels = |rows: Vec<(String, String)>| {
        let map: Map<String, Json> = rows.into_iter().map(|(key, text)| (key, text.into())).collect();
        Some(map).filter(|map| !map.is_empty())
    };
    put(&mut map, "enum", labels(point.labels.iter().map(|(n, text)| (n.to_string(), text.clone())).collect()));
    put(&mut map, "bits", labels(point.bit_labels.iter().map(|(n, text)| (n.to_string(), text.clone())).collect()));
    let nan: Vec<Json> = point.nan.iter().map(sentinel).collect();
    put(&mut map, "nan", Some(nan).filter(|nan| !nan.is_empty()));
    put(&mut map, "group", point.group.clone());
    put(&mut map, "note", point.note.clone());
    Json::Object(map)
}

/// A raw value that means "no value".
fn sentinel(nan: &Sentinel) -> Json {
    match nan {
        Sentinel::Whole(number) => {
            i64::try_from(*number).map(Json::from).or_else(|_| u64::try_from(*number).map(Json::from)).unwrap_or(Json::Null)
        }
        Sentinel::Float(number) => json!(number),
    }
}
