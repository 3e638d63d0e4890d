//! The quick ways of profiles say the same as the slow, obvious ones: blocks, numbers, filters.

#[path = "../../modlens-engine/tests/wire/mod.rs"]
mod wire;

use std::fmt::Write;
use std::sync::Arc;

use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_profiles::points::{BlockEntries, BlockPlan, BlockPlans, NumberBuffer, Plan, PlanInstance, RegisterBuffer};
use modlens_profiles::profile::{Profile, ProfileFormat};
use modlens_protocol::checksum::crc16;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::register_type::Space;
use modlens_readers::chunk::Chunk;
use modlens_tables::columns::{each_value, Cell, Table, TableKind};
use modlens_tables::predicate::Predicate;
use proptest::prelude::*;

use wire::in_pieces;

const ORDERS: [&str; 4] = ["ABCD", "CDAB", "BADC", "DCBA"];

/// What a random point may say beside its place; parts in braces are left out where they do not fit.
const KINDS: [(&str, u16); 24] = [
    ("type='u16'", 1),
    ("type='s16'\nscale=0.1", 1),
    ("type='u16'\nscale=0.1", 1),
    ("type='u16'\nscale=0.01\noffset=0", 1),
    ("type='u8h'\nscale=0.1", 1),
    ("type='u32'\nscale=0.01", 2),
    ("type='u16'\nscale=0.05\noffset=-40", 1),
    ("type='u16'\nscale=10", 1),
    ("type='s16'\nnan=0x8000", 1),
    ("type='s16'\nnan=-1\nscale=0.01", 1),
    ("type='u16'\nenum={1='on', 0='off'}", 1),
    ("type='u16'\nbits={0='run', 3='fault'}", 1),
    ("type='u16'\nsf='factor'", 1),
    ("type='s32'\nsf='factor'\nnan=0x80000000", 2),
    ("type='u32'", 2),
    ("type='s32'\nscale=0.001", 2),
    ("type='u32'\nscale=123456789", 2),
    ("type='f32'", 2),
    ("type='f32'\nscale=2.5", 2),
    ("type='f64'", 4),
    ("type='u64'", 4),
    ("type='bcd16'", 1),
    ("type='str'\ncount=3", 3),
    ("type='u32'\ncount=6", 6),
];

prop_compose! {
    /// A profile of points one after the other, with gaps; the last one holds the scale factor.
    fn profiles()(
        points in prop::collection::vec((0..KINDS.len(), 0..4usize, prop_oneof![4 => Just(0u16), 2 => 1..5u16, 1 => 60..200u16]), 1..30)
    ) -> Arc<Plan> {
        let mut text = String::from("profile = 1\n");
        let mut address = 5;
        for (i, (kind, order, gap)) in points.into_iter().enumerate() {
            let (keys, width) = KINDS[kind];
            address += gap;
            write!(text, "[[registers]]\nat='hr:{address}'\nname='p{i}'\norder='{}'\n{keys}\n", ORDERS[order]).unwrap();
            address += width;
        }
        write!(text, "[[registers]]\nat='hr:{address}'\nname='factor'\ntype='s16'\n").unwrap();
        write!(text, "[[registers]]\nat='hr:{}.2-5'\nname='part'\n", address + 1).unwrap();
        write!(text, "[[registers]]\nat='hr:{}.7'\nname='bit'\n", address + 1).unwrap();
        Arc::new(Plan::new(Profile::parse(&text, ProfileFormat::Toml).unwrap()))
    }
}

/// A block as the documentation of `Plan::block` says it: address, and the number of the value.
fn slow(plan: &Plan, first: usize, count: usize) -> Vec<(u16, Option<u32>)> {
    let values: Vec<(usize, usize, u32)> = plan
        .compiled_points()
        .iter()
        .zip(0..)
        .map(|(value, index)| (usize::from(value.address), usize::from(value.width), index))
        .filter(|(address, width, _)| *address >= first && address + width <= first + count)
        .collect();
    let mut found = Vec::new();
    for at in first..first + count {
        found.extend(values.iter().filter(|(address, ..)| *address == at).map(|(.., index)| (at as u16, Some(*index))));
        if !values.iter().any(|(address, width, _)| (*address..address + width).contains(&at)) {
            found.push((at as u16, None));
        }
    }
    found
}

proptest! {
    #[test]
    fn a_block_is_what_its_values_say(plan in profiles(), first in 0..400u16, count in 0..126usize) {
        let mut found = Vec::new();
        plan.block(Space::Holding, first, count, |step| found.push((step.address, step.compiled_index())));
        prop_assert_eq!(found, slow(&plan, usize::from(first), count));
        let mut other = 0;
        plan.block(Space::Input, first, count, |step| other += usize::from(step.compiled_index().is_none()));
        prop_assert_eq!(other, count);
    }

    #[test]
    fn numbers_are_those_of_values(
        plan in profiles(),
        factor in prop_oneof![Just(None), (-25i16..25).prop_map(Some)],
        words in prop::collection::vec(prop_oneof![3 => any::<u16>(), 1 => Just(0x8000), 1 => Just(0), 1 => Just(u16::MAX)], 400),
    ) {
        let mut bound = PlanInstance::new(Arc::clone(&plan));
        if let Some(factor) = factor {
            let holder = plan.compiled_points().iter().find(|value| value.name == "factor").unwrap();
            bound = bound.with_factors_from(Space::Holding, holder.address, &factor.to_be_bytes()).unwrap_or(bound);
        }
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        let mut steps = Vec::new();
        plan.block(Space::Holding, 0, words.len(), |step| steps.push(step));
        let mut numbers = Vec::new();
        bound.numbers(&steps, 0, &bytes, &mut NumberBuffer::default(), |some| numbers.extend_from_slice(some));
        for (step, number) in steps.iter().zip(numbers) {
            let at = 2 * usize::from(step.address);
            let expected = match step.compiled_index().map(|index| plan.compiled_point(index)) {
                None => Some(f64::from(words[usize::from(step.address)])),
                Some(value) => bound.value(value, &bytes[at..at + 2 * usize::from(value.width)]).number(),
            };
            let found = Some(number).filter(|number| !number.is_nan());
            prop_assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits), "{:?}", step);
        }
    }

    #[test]
    fn a_known_block_has_the_numbers_of_its_entries(
        plan in profiles(),
        factor in -25i16..25,
        first in 0..200u16,
        words in prop::collection::vec(prop_oneof![3 => any::<u16>(), 1 => Just(0x8000), 1 => Just(0), 1 => Just(u16::MAX)], 1..126),
    ) {
        let bound = PlanInstance::new(Arc::clone(&plan));
        let holder = plan.compiled_points().iter().find(|value| value.name == "factor").unwrap();
        let bound = Arc::new(bound.with_factors_from(Space::Holding, holder.address, &factor.to_be_bytes()).unwrap_or(bound));
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        let Some(block) = known_block(&bound, first, words.len()) else { return Ok(()) };
        let mut numbers = Vec::new();
        bound.numbers(&block.entries, first, &bytes, &mut NumberBuffer::default(), |some| numbers.extend_from_slice(some));
        let mut buffer = RegisterBuffer::default();
        let mut has = |wanted: &dyn Fn(f64) -> bool| block.has_number(&bytes, &mut buffer, wanted);
        for number in numbers.iter().filter(|number| !number.is_nan()) {
            prop_assert!(has(&|one| one.to_bits() == number.to_bits()), "{} is missing", number);
        }
        prop_assert!(!has(&|one| !one.is_nan() && numbers.iter().all(|number| number.to_bits() != one.to_bits())));
    }

    #[test]
    fn a_list_has_each_block_where_it_says(plan in profiles(), blocks in prop::collection::vec((0..2usize, 0..9u16, 2..6u16), 1..60)) {
        let units = [PlanInstance::new(Arc::clone(&plan)), PlanInstance::new(Arc::clone(&plan))].map(Arc::new);
        let mut known = BlockPlans::default();
        for asked in blocks.chunks(20) {
            let (list, mut plans) = (known.begin_list(), Vec::new());
            for &(unit, place, count) in asked {
                let first = 30 * place;
                let mut entries = Vec::new();
                plan.block(Space::Holding, first, usize::from(count), |entry| entries.push(entry));
                let block = (Space::Holding, first, count);
                match known.entries_of((list, &mut plans), &units[unit], block) {
                    BlockEntries::Listed(place, rows) => {
                        let listed: &Arc<BlockPlan> = &plans[place as usize];
                        prop_assert!(Arc::ptr_eq(&listed.instance, &units[unit]));
                        prop_assert_eq!((&listed.entries, rows as usize), (&entries, entries.len()));
                    }
                    BlockEntries::Bare => prop_assert!(entries.iter().all(|entry| entry.compiled_index().is_none())),
                    BlockEntries::Unknown => {}
                }
            }
        }
    }

    #[test]
    fn rows_and_filters(plan in profiles(), polls in prop::collection::vec((0..300u16, 1..40u16, any::<u32>()), 1..20), limit in -100i32..40_000) {
        let wanted = WantedTables { frames: false, transactions: true, findings: false };
        let mut session = Session::new(Arc::new(Functions::default()), wanted, false, None);
        session.bind(None, &[7], &plan);
        let mut options = BusOptions::named("bus");
        options.mode = Some(Mode::Rtu);
        let bus = session.add_bus(options);
        for (first, count, seed) in polls {
            session.feed(bus, &Chunk { bytes: &exchange(first, count, seed), ..Chunk::default() });
        }
        session.flush();
        let table = Table::new(Arc::new(session.take()), TableKind::Readings);
        rows_are_the_parts(&table);
        for op in ["==", "!=", "<", "<=", ">", ">="] {
            let quick = format!(r#"["cmp", "{op}", ["col", "value"], ["num", {limit}]]"#);
            // Two of them are looked at row by row.
            let slow = format!(r#"["and", {quick}, {quick}]"#);
            let [quick, slow] = [quick, slow].map(|tree| Predicate::new("readings", &tree).unwrap().filter(&table));
            prop_assert_eq!(addresses(&quick), addresses(&slow), "{}", op);
            let twice = Predicate::new("readings", &format!(r#"["cmp", "<", ["col", "value"], ["num", {limit}]]"#)).unwrap();
            prop_assert_eq!(twice.filter(&quick).len(), (0..quick.len()).filter(|&row| twice.holds(&quick, row)).count());
        }
    }
}

/// A block of holding registers that was asked for twice; `None` if no value is near.
fn known_block(instance: &Arc<PlanInstance>, first: u16, count: usize) -> Option<Arc<BlockPlan>> {
    let (mut known, mut plans) = (BlockPlans::default(), Vec::new());
    let list = known.begin_list();
    let block = (Space::Holding, first, count as u16);
    assert_eq!(known.entries_of((list, &mut plans), instance, block), BlockEntries::Unknown);
    match known.entries_of((list, &mut plans), instance, block) {
        BlockEntries::Listed(0, _) => plans.pop(),
        BlockEntries::Bare => None,
        other => panic!("{other:?}"),
    }
}

/// Readings and findings of the same bytes in blocks.
fn told(plan: &Arc<Plan>, bytes: &[u8], piece: usize) -> (Vec<String>, Vec<String>) {
    let mut session = Session::default();
    session.bind(None, &[7], plan);
    let batch = Arc::new(in_pieces(&mut session, bytes, piece));
    let findings = batch.findings.iter().map(|row| format!("{:?} {:?} {}", row.txn, row.finding, row.detail)).collect();
    let table = Table::new(batch, TableKind::Readings);
    let value = table.kind.column("value_text").unwrap();
    let values = (0..table.len()).map(|row| format!("{:?}", table.cell(row, value))).collect();
    (values, findings)
}

#[test]
fn what_a_profile_says_does_not_depend_on_the_way_of_the_bytes() {
    let text = "profile = 1\n[device]\nfunctions = [3]\n[[registers]]\nat='hr:0'\nname='float'\ntype='f32'\n\
        [[registers]]\nat='hr:2'\nname='power'\nsf='factor'\n[[registers]]\nat='hr:3'\nname='factor'\ntype='s16'\n\
        [[registers]]\nat='hr:4'\nname='never read'\ntype='f64'\n";
    let plan = Arc::new(Plan::new(Profile::parse(text, ProfileFormat::Toml).unwrap()));
    let mut bytes = Vec::new();
    for i in 0..120u32 {
        // A float with the low register in front, a power, its factor, which changes once, and a function not listed.
        let [a, b, c, d] = ((f64::from(i) * 0.37).sin() as f32 * 3.0 + 21.0).to_bits().to_be_bytes();
        let factor = if i < 60 { 0xFFFE_u16 } else { 0xFFFF };
        let mut answer = vec![7, 3, 8, c, d, a, b, 0, i as u8];
        answer.extend(factor.to_be_bytes());
        let bodies = [vec![7, 3, 0, 0, 0, 4], answer, vec![7, 4, 0, 9, 0, 1], vec![7, 4, 2, 0, i as u8]];
        bytes.extend(bodies.iter().flat_map(|body| [body, &crc16(body).to_le_bytes()[..]].concat()));
    }
    let (values, findings) = told(&plan, &bytes, bytes.len());
    assert_eq!(values.len(), 4 * 120);
    assert_eq!(findings.iter().filter(|text| text.contains("UnsupportedFunction")).count(), 120);
    assert_eq!(findings.iter().filter(|text| text.contains("OrderMismatch")).count(), 1);
    assert!(values[4 * 59 + 1].contains("-2") && values[4 * 60 + 1].contains("-1"), "{:?}", &values[4 * 59..4 * 61]);
    for piece in [1, 7, 64] {
        assert_eq!(told(&plan, &bytes, piece), (values.clone(), findings.clone()), "{piece}");
    }
}

/// A poll of a few registers, and every third time a write of one.
fn exchange(first: u16, count: u16, seed: u32) -> Vec<u8> {
    let [a, b] = first.to_be_bytes();
    let mut bodies = vec![vec![7, 3, a, b, 0, count as u8], vec![7, 3, 2 * count as u8]];
    bodies[1].extend((0..2 * u32::from(count)).map(|i| (seed.wrapping_mul(2 * i + 1) >> 13) as u8));
    if seed.is_multiple_of(3) {
        bodies.extend([vec![7, 6, a, b, 0, seed as u8], vec![7, 6, a, b, 0, seed as u8]]);
    }
    bodies.into_iter().flat_map(|body| [&body[..], &crc16(&body).to_le_bytes()].concat()).collect()
}

fn addresses(table: &Table) -> Vec<String> {
    let [txn, address, name] = ["txn", "address", "name"].map(|key| table.kind.column(key).unwrap());
    (0..table.len())
        .map(|row| format!("{:?} {:?} {:?}", table.cell(row, txn), table.cell(row, address), table.cell(row, name)))
        .collect()
}

/// Rows are looked up from anywhere; parts are gone through from the start.
fn rows_are_the_parts(table: &Table) {
    let [address, name] = ["address", "name"].map(|key| table.kind.column(key).unwrap());
    let mut row = 0;
    each_value(&table.batch, |part| {
        assert!(matches!(table.cell(row, address), Cell::Int(at) if at == i64::from(part.address)));
        match (table.cell(row, name), part.compiled) {
            (Cell::Text(name), Some((_, compiled))) => assert_eq!(name, compiled.name),
            (cell, compiled) => assert!(matches!(cell, Cell::Null) && compiled.is_none()),
        }
        row += 1;
    });
    assert_eq!(row, table.len());
}
