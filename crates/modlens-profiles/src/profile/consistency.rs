//! Checks the points of a profile against each other: names used twice, registers taken twice, missing scale factors.

use std::collections::HashMap;

use crate::profile::model::{Mistake, Point, Profile};
use modlens_protocol::register_type::Space;

/// Checks all points against each other.
pub fn check(profile: &Profile, mistakes: &mut Vec<Mistake>) {
    let mut names: HashMap<&str, usize> = HashMap::new();
    for (i, point) in profile.points.iter().enumerate() {
        if let Some(first) = names.insert(&point.name, i) {
            let line = profile.points[first].lines.name;
            let message = if line > 0 {
                format!("{:?} is the name of the point in line {line}, too", point.name)
            } else {
                format!("{:?} is the name of two points", point.name)
            };
            mistakes.push(Mistake::new(point.lines.name, &format!("registers[{}].name", point.lines.index), message));
        }
    }
    for point in &profile.points {
        let Some(sf) = &point.sf else { continue };
        let key = format!("registers[{}].sf", point.lines.index);
        match names.get(sf.as_str()).map(|&at| &profile.points[at]) {
            None => {
                let hint = crate::profile::keys::similar_word(sf, names.keys().copied()).map(str::to_owned);
                let message = format!("there is no point {sf:?} for the scale factor");
                mistakes.push(Mistake { line: point.lines.sf, key, message, hint });
            }
            Some(holder) if !holder.kind.is_integer() || holder.value_count() != 1 || holder.sf.is_some() => {
                let message = format!("{sf:?} is not a single whole number, as a scale factor must be");
                mistakes.push(Mistake::new(point.lines.sf, &key, message));
            }
            Some(_) => {}
        }
    }
    overlaps(&profile.points, mistakes);
}

/// Reports registers that belong to two points. Only bit fields and bytes may share a register.
fn overlaps(points: &[Point], mistakes: &mut Vec<Mistake>) {
    for space in Space::ALL.map(|row| row.0) {
        let mut ranges: Vec<(u32, u32, usize)> = points
            .iter()
            .enumerate()
            .filter(|(_, point)| point.space == space && !is_part(point))
            .map(|(i, point)| (u32::from(point.address), u32::from(point.address) + u32::from(point.count), i))
            .collect();
        ranges.sort_unstable();
        let mut furthest_end: Option<(u32, usize)> = None;
        for (start, end, i) in ranges {
            if let Some((end_so_far, other)) = furthest_end.filter(|(end_so_far, _)| *end_so_far > start) {
                let (point, other) = (&points[i], &points[other]);
                let message = format!("takes wire address {start} of {}, which belongs to {:?}", space.short_name(), other.name);
                mistakes.push(Mistake::new(point.lines.at, &format!("registers[{}].at", point.lines.index), message));
                furthest_end = Some((end_so_far.max(end), i));
                continue;
            }
            furthest_end = Some((end, i));
        }
    }
}

/// Whether a point takes only a part of a register.
fn is_part(point: &Point) -> bool {
    point.bits.is_some() || point.kind.bits() == 8
}
