"""The reader of Rust imports, on crates of a few lines."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.cycles import cycles
from tests.support.rust_imports import crate_imports, describe_cycles
from tests.support.rust_tokens import tokens, without_tests


def crate(folder: Path, **files: str) -> Path:
    """A crate's `src`; `a__b` is the file a/b.rs."""
    for name, text in files.items():
        path = folder / (name.replace("__", "/") + ".rs")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def imports(source: Path) -> dict[str, dict[str, set[str]]]:
    """For each file that imports another, the names it takes from where."""
    return {
        file: {target: {reference.name for reference in why} for target, why in needed.items()}
        for file, needed in crate_imports(source).items()
        if needed
    }


def test_the_ways_to_write_a_path(tmp_path: Path) -> None:
    """From the root, from the parent, from a child, from a module that was imported, and inline."""
    source = crate(
        tmp_path,
        lib="mod a; mod b; mod c;",
        a__mod="mod inner; pub struct A; use self::inner::Inner;",
        a__inner="use super::super::b::{self, B as Other}; pub struct Inner; fn f() { b::g(); }",
        b="pub struct B; pub fn g() -> Other { crate::c::h() } use std::fmt; enum E { c }",
        c="use crate::a; pub fn h(it: &a::A) -> u8 { it.0 }",
    )
    assert imports(source) == {
        "a/mod.rs": {"a/inner.rs": {"Inner"}},
        "a/inner.rs": {"b.rs": {"B", "g"}},
        "b.rs": {"c.rs": {"h"}},
        "c.rs": {"a/mod.rs": {"A"}},
    }


def test_a_name_that_is_passed_on_is_found_where_it_is_defined(tmp_path: Path) -> None:
    """Through `pub use`, a private `use` that children see, and `*`."""
    source = crate(
        tmp_path,
        lib="mod a; mod b; mod user; pub use user::go;",
        a__mod="mod leaf; pub use leaf::Leaf as Renamed; pub use crate::b::*; use leaf::hidden;",
        a__leaf="pub struct Leaf; pub(super) fn hidden() {}",
        a="",
        b="pub const LIMIT_BYTES: usize = 1;",
        user="use crate::a::{LIMIT_BYTES, Renamed}; pub fn go() { Renamed::new(); }",
    )
    (tmp_path / "a.rs").unlink()
    assert imports(source)["user.rs"] == {"a/leaf.rs": {"Leaf"}, "b.rs": {"LIMIT_BYTES"}}
    assert "lib.rs" not in imports(source), "to pass a name on is no need of it"
    assert imports(source)["a/mod.rs"] == {"a/leaf.rs": {"hidden"}}


def test_a_module_and_a_function_of_one_name(tmp_path: Path) -> None:
    source = crate(
        tmp_path,
        lib="mod a; mod b;",
        a__mod="mod judge; pub use judge::judge; pub use judge::Claim;",
        a__judge="pub fn judge() {} pub struct Claim;",
        b="use crate::a::judge; use crate::a; fn f() { judge(); a::judge(); }",
    )
    assert imports(source) == {"b.rs": {"a/judge.rs": {"judge"}}}


def test_what_a_macro_defines_belongs_to_its_file(tmp_path: Path) -> None:
    source = crate(
        tmp_path,
        lib="mod a; mod b;",
        a="macro_rules! made { ($($t:tt)*) => { pub enum Finding { $($t)* } } } made! { A }",
        b="use crate::a::Finding; fn f() -> Finding { Finding::A }",
    )
    assert imports(source) == {"b.rs": {"a.rs": {"Finding"}}}


@pytest.mark.parametrize(
    "text",
    [
        "#[cfg(test)] mod tests { use crate::b::B; fn f(it: [u8; 2]) {} }",
        "#[cfg(test)] mod tests;",
        "#[cfg(test)] use crate::b::{B, C};",
        "#[cfg(test)] #[allow(dead_code)] pub fn f(b: crate::b::B) -> u8 { 1 }",
        "struct S { #[cfg(test)] seen: crate::b::B, kept: u8 }",
        "struct S { kept: u8, #[cfg(test)] seen: crate::b::B }",
        '// use crate::b::B;\n/* crate::b::B */ const A: &str = "crate::b::B";',
        "const A: &str = r#\"a \" crate::b::B\"#; const Q: char = '\"'; const R: char = '\\'';",
        "fn f<'a>(it: &'a str) -> &'a str { it }",
        "use modlens_other::b::B; fn f() { std::mem::take(&mut 1); b::g(); }",
    ],
)
def test_what_is_no_import(text: str, tmp_path: Path) -> None:
    """Tests, comments, strings, and other crates; what follows them is read again."""
    source = crate(tmp_path, lib="mod a; mod b; mod c;", a=f"{text} use crate::c::C;", b="", c="")
    assert imports(source) == {"a.rs": {"c.rs": {"C"}}}


def test_lines_are_those_of_the_file(tmp_path: Path) -> None:
    text = "/* one\ntwo */\nuse crate::b::B; // three\n\nfn f() {\n    crate::b::g()\n}\n"
    source = crate(tmp_path, lib="mod a; mod b;", a=text, b="")
    assert [(r.name, r.line) for r in crate_imports(source)["a.rs"]["b.rs"]] == [("B", 3), ("g", 6)]


def test_nothing_behind_a_test_is_lost() -> None:
    text = "#[test] fn a() { if b { c } } fn d() {} #[cfg(test)] mod e { fn f() {} } g"
    assert [token.text for token in without_tests(tokens(text))] == [*"fn d ( ) { }".split(), "g"]


def test_binaries_of_a_crate_are_read(tmp_path: Path) -> None:
    source = crate(tmp_path, lib="", main="mod options; use options::Options;", options="")
    assert imports(source) == {"main.rs": {"options.rs": {"Options"}}}


def test_a_circle_is_shown_with_the_lines_that_tie_it(tmp_path: Path) -> None:
    source = crate(
        tmp_path,
        lib="mod a; mod b; mod c;",
        a="\nuse crate::b::B; pub struct A;",
        b="use crate::c; pub struct B; pub fn f() { c::g() }",
        c="use crate::a::A; pub fn g() {}",
    )
    assert describe_cycles(crate_imports(source)) == [
        "3 files need each other: a.rs, b.rs, c.rs\n"
        "  a.rs:2 -> b.rs: B\n"
        "  b.rs:1 -> c.rs: g\n"
        "  c.rs:1 -> a.rs: A"
    ]


def test_circles_are_whole_groups() -> None:
    """Two circles that share a file are one; a file that imports itself is none."""
    graph = {"a": {"b"}, "b": {"a", "c"}, "c": {"b", "d"}, "d": {"d"}, "e": {"f"}, "f": {"e", "a"}}
    assert cycles(graph) == [["a", "b", "c"], ["e", "f"]]


def test_a_long_chain_is_no_circle() -> None:
    chain = {str(number): {str(number + 1)} for number in range(300)}
    assert cycles(chain) == []
    assert len(cycles(chain | {"300": {"0"}})[0]) == 301
