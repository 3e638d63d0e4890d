//! Device profiles (register maps): which registers have which meaning. One data model with three notations: TOML, YAML
//! and CSV.
//!
//! A file is read to its end whatever is wrong with it, and all mistakes are reported together, with line and key.
//! `keys` lists the keys of the format; `points` compiles a profile to a plan that converts registers to values.

mod check;
mod consistency;
mod csv;
mod json;
pub mod keys;
mod model;
mod point_address;
mod schema;
mod source_tree;
mod toml;
mod types;
mod yaml;

pub use json::to_json;
pub use model::{AddressBase, Device, KeyLines, Mistake, Point, Profile, Sentinel};
pub use schema::schema;
pub use types::{decimal_text, Access, Decimal, Order, Type};

use serde_json::Value as Json;

/// The profiles that are shipped: name and TOML text, from `dissectors/profiles/`.
pub const SHIPPED: &[(&str, &str)] = &[
    ("mightyzap", include_str!("../../../../dissectors/profiles/mightyzap.toml")),
    ("grundfos", include_str!("../../../../dissectors/profiles/grundfos.toml")),
    ("abb-b-series", include_str!("../../../../dissectors/profiles/abb-b-series.toml")),
    ("carlo-gavazzi-em24", include_str!("../../../../dissectors/profiles/carlo-gavazzi-em24.toml")),
    ("chint-dtsu666", include_str!("../../../../dissectors/profiles/chint-dtsu666.toml")),
    ("delta-vfd", include_str!("../../../../dissectors/profiles/delta-vfd.toml")),
    ("deye-storage", include_str!("../../../../dissectors/profiles/deye-storage.toml")),
    ("durapulse-gs3", include_str!("../../../../dissectors/profiles/durapulse-gs3.toml")),
    ("eastron-sdm120", include_str!("../../../../dissectors/profiles/eastron-sdm120.toml")),
    ("eastron-sdm230", include_str!("../../../../dissectors/profiles/eastron-sdm230.toml")),
    ("eastron-sdm630", include_str!("../../../../dissectors/profiles/eastron-sdm630.toml")),
    ("eastron-sdm72v2", include_str!("../../../../dissectors/profiles/eastron-sdm72v2.toml")),
    ("eaton-m-max", include_str!("../../../../dissectors/profiles/eaton-m-max.toml")),
    ("eg4-luxpower", include_str!("../../../../dissectors/profiles/eg4-luxpower.toml")),
    ("epever-tracer", include_str!("../../../../dissectors/profiles/epever-tracer.toml")),
    ("growatt-tlx", include_str!("../../../../dissectors/profiles/growatt-tlx.toml")),
    ("huawei-sun2000", include_str!("../../../../dissectors/profiles/huawei-sun2000.toml")),
    ("inepro-pro380", include_str!("../../../../dissectors/profiles/inepro-pro380.toml")),
    ("orno-we-516", include_str!("../../../../dissectors/profiles/orno-we-516.toml")),
    ("pzem-004t", include_str!("../../../../dissectors/profiles/pzem-004t.toml")),
    ("renogy-rover", include_str!("../../../../dissectors/profiles/renogy-rover.toml")),
    ("siemens-pac2200", include_str!("../../../../dissectors/profiles/siemens-pac2200.toml")),
    ("sma-sunny", include_str!("../../../../dissectors/profiles/sma-sunny.toml")),
    ("socomec-countis", include_str!("../../../../dissectors/profiles/socomec-countis.toml")),
    ("sofar-g3", include_str!("../../../../dissectors/profiles/sofar-g3.toml")),
    ("victron-gx", include_str!("../../../../dissectors/profiles/victron-gx.toml")),
    ("xy-md02", include_str!("../../../../dissectors/profiles/xy-md02.toml")),
];

/// `SunSpec` models: number and TOML text, from `dissectors/profiles/sunspec/`. Their addresses count from the ID
/// register of the model.
pub const SUNSPEC: &[(u16, &str)] = &[
    (1, include_str!("../../../../dissectors/profiles/sunspec/model_1.toml")),
    (101, include_str!("../../../../dissectors/profiles/sunspec/model_101.toml")),
    (102, include_str!("../../../../dissectors/profiles/sunspec/model_102.toml")),
    (103, include_str!("../../../../dissectors/profiles/sunspec/model_103.toml")),
    (111, include_str!("../../../../dissectors/profiles/sunspec/model_111.toml")),
    (112, include_str!("../../../../dissectors/profiles/sunspec/model_112.toml")),
    (113, include_str!("../../../../dissectors/profiles/sunspec/model_113.toml")),
    (120, include_str!("../../../../dissectors/profiles/sunspec/model_120.toml")),
    (121, include_str!("../../../../dissectors/profiles/sunspec/model_121.toml")),
    (122, include_str!("../../../../dissectors/profiles/sunspec/model_122.toml")),
    (123, include_str!("../../../../dissectors/profiles/sunspec/model_123.toml")),
];

/// The notation of a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileFormat {
    /// TOML.
    Toml,
    /// CSV.
    Csv,
    /// YAML.
    Yaml,
    /// Plain JSON.
    Json,
}

impl ProfileFormat {
    /// The notation with this name.
    pub fn from_word(word: &str) -> Option<Self> {
        let all = [("toml", Self::Toml), ("csv", Self::Csv), ("yaml", Self::Yaml), ("json", Self::Json)];
        all.into_iter().find(|(name, _)| *name == word).map(|(_, form)| form)
    }
}

impl Profile {
    /// Parses a profile. The error lists all mistakes, sorted by line.
    ///
    /// ```
    /// use modlens_profiles::profile::{ProfileFormat, Profile};
    /// let mistakes = Profile::parse("profile = 1\n[[registers]]\nat = 'hr:1'\ntyp = 'u23'\n", ProfileFormat::Toml).unwrap_err();
    /// assert_eq!((mistakes.len(), mistakes[0].line), (2, 2)); // no name, and no key `typ`
    /// ```
    pub fn parse(text: &str, form: ProfileFormat) -> Result<Self, Vec<Mistake>> {
        let mut mistakes = Vec::new();
        let tree = match form {
            ProfileFormat::Toml => toml::parse(text, &mut mistakes),
            ProfileFormat::Csv => csv::parse(text, &mut mistakes),
            ProfileFormat::Yaml => yaml::parse(text).map_err(|mistake| vec![mistake])?,
            ProfileFormat::Json => {
                let json: Json =
                    serde_json::from_str(text).map_err(|error| vec![Mistake::new(0, "", format!("not JSON: {error}"))])?;
                source_tree::from_json(&json)
            }
        };
        let profile = check::profile(&tree, &mut mistakes);
        consistency::check(&profile, &mut mistakes);
        if mistakes.is_empty() {
            return Ok(profile);
        }
        mistakes.sort_by_key(|mistake| mistake.line);
        Err(mistakes)
    }

    /// The shipped profile with this name.
    pub fn shipped(name: &str) -> Option<Self> {
        let (_, text) = SHIPPED.iter().find(|(known, _)| *known == name)?;
        Self::parse(text, ProfileFormat::Toml).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_profiles_have_no_mistakes() {
        for (number, text) in SUNSPEC {
            assert_eq!(Profile::parse(text, ProfileFormat::Toml).unwrap().device.sunspec, Some(*number));
        }
        for (name, text) in SHIPPED {
            if let Err(mistakes) = Profile::parse(text, ProfileFormat::Toml) {
                panic!("{name}: {mistakes:?}");
            }
        }
    }
}
