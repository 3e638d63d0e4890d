"""The questions of filters about registers: touches(hr, 107) and writes(hr, range(100, 110))."""

from __future__ import annotations

import ast

from analyzer import addresses
from analyzer.filter_refusals import Refusals
from analyzer.filter_terms import Tree, constant

__all__ = ["RegisterQuestions"]

# The number of arguments of touches(), writes() and range().
ARGUMENTS = 2


class RegisterQuestions(Refusals):
    """Compiles the calls in a filter; everything else is the compiler's."""

    def _function_call(self, node: ast.Call) -> Tree:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in ("touches", "writes"):
            self._refuse_call(node)
        if "address" not in self._column_types:
            self._refuse(node, f"{name}() needs registers, which {self._table} do not have")
        if len(node.args) != ARGUMENTS or node.keywords:
            self._refuse(node, f"{name}() takes a register type and an address: {name}(hr, 107)")
        kind = self._register_type(node.args[0])
        first, last = self._span(node.args[1], kind)
        return [name, kind, first, last]

    def _register_type(self, node: ast.expr) -> str:
        word = node.id if isinstance(node, ast.Name) else constant(node)
        kind = addresses.register_type(word) if isinstance(word, str) else None
        if kind is None:
            self._refuse(node, "a register type is one of co, di, ir, hr")
        return kind

    def _span(self, node: ast.expr, kind: str) -> tuple[int, int]:
        """First and last wire address of the second argument of touches() and writes()."""
        if isinstance(node, ast.Call):
            named_range = isinstance(node.func, ast.Name) and node.func.id == "range"
            if not named_range or len(node.args) != ARGUMENTS or node.keywords:
                self._refuse(node, "a range is range(first, last + 1)")
            first = self._wire(node.args[0], kind)
            behind = self._wire(node.args[1], kind, top=0x10000)
            if behind <= first:
                self._refuse(node, "an empty range; write range(first, last + 1)")
            return first, behind - 1
        wire = self._wire(node, kind)
        return wire, wire

    def _wire(self, node: ast.expr, kind: str, top: int = 0xFFFF) -> int:
        """A wire address from a number, or from text such as '40108' of this register type.

        `top` is the highest number allowed.
        """
        value = constant(node)
        if isinstance(value, str):
            address = addresses.parse(value)
            if address is None:
                self._refuse(node, f"{value!r} is not an address; write 107, '40108' or '4x006B'")
            if address.register_type != kind:
                self._refuse(node, f"{value!r} is an address of a {address.register_type}")
            return address.wire
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= top:
            self._note_number(node)
            self._refuse(node, "an address is a number from 0 to 65535, or text such as '40108'")
        self._note_number(node)
        return value
