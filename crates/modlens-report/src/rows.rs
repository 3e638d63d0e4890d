//! Rows of a table, wherever they are in the document.

use serde_json::{Map, Value as Json};

/// An object of the document, with the plain values of the objects around it.
#[derive(Clone)]
pub struct Row<'a> {
    /// From the outermost to the innermost.
    objects: Vec<&'a Map<String, Json>>,
}

impl<'a> From<&'a Map<String, Json>> for Row<'a> {
    fn from(object: &'a Map<String, Json>) -> Self {
        Self { objects: vec![object] }
    }
}

impl<'a> Row<'a> {
    /// The value at a path of keys, such as `cycle.p50_us`; none where it is missing or null.
    pub fn at(&self, path: &str) -> Option<&'a Json> {
        let mut keys = path.split('.');
        let first = self.own(keys.next()?)?;
        keys.try_fold(first, |value, key| value.get(key)).filter(|value| !value.is_null())
    }

    fn own(&self, key: &str) -> Option<&'a Json> {
        let (innermost, around) = self.objects.split_last()?;
        innermost.get(key).or_else(|| {
            let found = around.iter().rev().find_map(|object| object.get(key))?;
            (!found.is_object() && !found.is_array()).then_some(found)
        })
    }
}

/// The rows at a path, such as `x[].y[]`, which goes over lists in lists.
pub fn rows_at<'a>(document: &'a Json, path: &str) -> Vec<Row<'a>> {
    let mut found = vec![(Row { objects: Vec::new() }, document)];
    for part in path.split('.') {
        let key = part.strip_suffix("[]");
        let deeper = found.iter().flat_map(|(row, value)| {
            let value = value.get(key.unwrap_or(part)).unwrap_or(&Json::Null);
            let items = if key.is_some() { value.as_array().map_or(&[][..], Vec::as_slice) } else { std::slice::from_ref(value) };
            items.iter().filter_map(|item| {
                let mut inner = row.clone();
                inner.objects.push(item.as_object()?);
                Some((inner, item))
            })
        });
        found = deeper.collect();
    }
    found.into_iter().map(|(row, _)| row).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_row_has_the_plain_values_of_what_is_around_it() {
        let document = json!({
            "version": 1,
            "buses": [{"bus": "a", "mode": "rtu", "units": [{"unit": 1, "mode": "tcp", "time": {"p50": 7}}, {"unit": 2}]}, {"bus": "b"}],
        });
        let rows = rows_at(&document, "buses[].units[]");
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[0].at("bus"), Some(&json!("a")));
        assert_eq!(rows[0].at("mode"), Some(&json!("tcp")), "its own value first");
        assert_eq!(rows[1].at("mode"), Some(&json!("rtu")));
        assert_eq!(rows[0].at("time.p50"), Some(&json!(7)));
        assert_eq!(rows[1].at("time.p50"), None);
        assert_eq!(rows[1].at("units"), None, "lists around it are no values of the row");
        assert_eq!(rows[1].at("version"), None, "the document is no row");
        assert!(rows_at(&document, "overview.examples[]").is_empty());
    }
}
