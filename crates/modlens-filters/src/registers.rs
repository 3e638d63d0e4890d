//! The questions of filters about registers: `touches(hr, 107)` and `writes(hr, range(100, 110))`.

use modlens_protocol::register_type::Space;
use serde_json::{json, Value as Json};

use crate::address;
use crate::compiler::{Compiler, Tree};
use crate::error::FilterError;
use crate::spelling::quoted;
use crate::syntax::{Kind, Node};

impl Compiler<'_> {
    /// The tree of a call.
    pub fn call(&mut self, node: &Node, name: Option<&str>, arguments: &[Node], is_plain: bool) -> Tree {
        let Some(name @ ("touches" | "writes")) = name else { return Err(self.unknown_call(name, node)) };
        if self.kind_of("address").is_none() {
            return Err(self.refusal(node, format!("{name}() needs registers, which {} do not have", self.table)));
        }
        let ([kind, place], true) = (arguments, is_plain) else {
            let message = format!("{name}() takes a register type and an address: {name}(hr, 107)");
            return Err(self.refusal(node, message));
        };
        let space = match &kind.kind {
            Kind::Name(word) | Kind::Text(word) => Space::from_word(word),
            _ => None,
        };
        let Some(space) = space else { return Err(self.refusal(kind, "a register type is one of co, di, ir, hr")) };
        let (first, last) = self.span(place, space)?;
        Ok(json!([name, space.long_name(), first, last]) as Json)
    }

    /// First and last wire address of the second argument.
    fn span(&mut self, node: &Node, space: Space) -> Result<(i64, i64), FilterError> {
        let Kind::Call { name, arguments, is_plain } = &node.kind else {
            let wire = self.wire(node, space, address::LAST_ADDRESS)?;
            return Ok((wire, wire));
        };
        let (Some("range"), [first, behind], true) = (name.as_deref(), arguments.as_slice(), *is_plain) else {
            return Err(self.refusal(node, "a range is range(first, last + 1)"));
        };
        let first = self.wire(first, space, address::LAST_ADDRESS)?;
        let behind = self.wire(behind, space, address::LAST_ADDRESS + 1)?;
        if behind <= first {
            return Err(self.refusal(node, "an empty range; write range(first, last + 1)"));
        }
        Ok((first, behind - 1))
    }

    /// A wire address from a number up to `top`, or from a text such as '40108' of this register type.
    fn wire(&mut self, node: &Node, space: Space, top: i64) -> Result<i64, FilterError> {
        if let Kind::Text(text) = &node.kind {
            let Some((found, wire)) = address::parse(text) else {
                let message = format!("{} is not an address; write 107, '40108' or '4x006B'", quoted(text));
                return Err(self.refusal(node, message));
            };
            if found != space {
                return Err(self.refusal(node, format!("{} is an address of a {}", quoted(text), found.long_name())));
            }
            return Ok(wire);
        }
        self.note_number(node)?;
        match node.kind {
            Kind::Integer(Some(number)) if (0..=top).contains(&number) => Ok(number),
            _ => Err(self.refusal(node, "an address is a number from 0 to 65535, or text such as '40108'")),
        }
    }
}
