"""Units of what is drawn, read from the source: names and labels of axes end in their unit."""

import ast
import re

ENDINGS = {"ms": "ms", "s": "s", "hz": "Hz", "nats": "nats", "deg": "deg", "mm": "mm"}
READINGS = re.compile(r"(?:^|_)(?:steps|readings)$")
LABELLED = re.compile(r"[(,] ?(ms|s|Hz|nats|deg|degrees|mm|readings)\)?$|^(?:\w+ )*(readings)$")
SAME = {"degrees": "deg"}
KEEPING = (
    *("mean", "median", "nanmean", "asarray", "array", "sort", "unique", "abs", "min", "max"),
    *("to_numpy", "ravel", "round", "sum", "std", "concatenate", "smoothed", "astype", "where"),
)
TIMED = ("decide", "first_crossing", "run")
"""Calls whose results draw themselves over ms."""
FIRST_TWO = ("plot", "step", "scatter", "errorbar", "fill_between", "bar", "barh", "text")


def of_name(name):
    """Return the unit that a name or a column ends in, or None."""
    if READINGS.search(name):
        return "readings"
    return ENDINGS.get(name.rpartition("_")[2]) if "_" in name else None


def of_label(text):
    """Return the unit of an axis by its label, or None."""
    match = LABELLED.search(text.replace("\n", " ").strip())
    unit = (match[1] or match[2]) if match else None
    return SAME.get(unit, unit)


class Units(ast.NodeVisitor):
    """What each axis shows, by the names in one function, or in the cells of a notebook.

    ``axes`` has the units of each axis: pairs of the Axes' expression and "x" or "y", and for each
    unit the lines of the source.
    """

    def __init__(self, constants):
        self.names, self.calls, self.axes, self.done = {}, {}, {}, []
        self.constants = constants

    def unit(self, node):
        """Return the unit of an expression, None if unknown, a tuple for a tuple."""
        match node:
            case ast.Name(name):
                return self.names.get(name, of_name(name))
            case ast.Attribute(value, name):
                return of_name(name) or self.unit(value)
            case ast.Subscript(value, ast.Constant(str(column))):
                return of_name(column)
            case ast.Subscript(value, place):
                return None if isinstance(place, ast.Tuple | ast.List) else self.unit(value)
            case ast.Tuple(parts):
                return tuple(self.unit(part) for part in parts)
            case ast.UnaryOp(_, value):
                return self.unit(value)
            case ast.Call(called, args):
                return self.of_call(called, args)
            case ast.BinOp(left, op, right):
                return combined(self.unit(left), op, self.unit(right), right)
        return None

    def of_call(self, called, args):
        """Return the unit of what a call returns, if it is that of what it is given."""
        name = called.attr if isinstance(called, ast.Attribute) else ast.unparse(called)
        if name not in KEEPING:
            return None
        on = called.value if isinstance(called, ast.Attribute) else None
        return self.unit(args[0] if args and (on is None or of_module(on)) else on)

    def visit_Assign(self, node):
        self.generic_visit(node)
        unit = self.unit(node.value)
        called = node.value.func if isinstance(node.value, ast.Call) else None
        if isinstance(called, ast.Attribute) and called.attr == "subplots":
            self.done += self.axes.items()
            self.axes = {}
        for target in node.targets:
            pairs = [(target, unit)]
            if isinstance(target, ast.Tuple):
                pairs = zip(target.elts, unit, strict=False) if isinstance(unit, tuple) else []
            for name, each in pairs:
                if isinstance(name, ast.Name) and (each or name.id in self.names):
                    self.names[name.id] = each
                if isinstance(name, ast.Name) and isinstance(called, ast.Attribute):
                    self.calls[name.id] = called.attr

    def visit_FunctionDef(self, node):
        """Another scope."""

    def visit_Call(self, node):
        self.generic_visit(node)
        if not isinstance(node.func, ast.Attribute):
            return
        on, method = ast.unparse(node.func.value), node.func.attr
        keywords = {each.arg: each.value for each in node.keywords}
        for axis in "xy":
            label = keywords.get(f"{axis}label") if method == "set" else None
            if method == f"set_{axis}label":
                label = node.args[0]
            if text := self.text(label):
                self.add(on, axis, of_label(text), node)
        if method in FIRST_TWO:
            drawn = [part for arg in node.args for part in self.flat(arg)]
            for axis, unit in zip("xy", drawn, strict=False):
                self.add(on, axis, unit, node)
        elif method in ("axvline", "axhline", "hist", "axvspan", "axhspan") and node.args:
            self.add(on, "y" if "h" in method[2] else "x", self.unit(node.args[0]), node)
        if method == "plot" and self.calls.get(on) in TIMED:
            ax = keywords.get("ax", node.args[0] if node.args else None)
            if ax is not None:
                self.add(ast.unparse(ax), "x", "ms", node)

    def flat(self, arg):
        unit = self.unit(arg.value if isinstance(arg, ast.Starred) else arg)
        return unit if isinstance(arg, ast.Starred) and isinstance(unit, tuple) else [unit]

    def text(self, label):
        """Return a label's text, without the parts computed at run time."""
        match label:
            case ast.Constant(str(text)):
                return text
            case ast.Name(name):
                return self.constants.get(name)
            case ast.JoinedStr([*_, ast.Constant(str(text))]):
                return text
        return None

    def add(self, on, axis, unit, node):
        if isinstance(unit, str):
            self.axes.setdefault((on, axis), {}).setdefault(unit, []).append(node.lineno)


def of_module(node):
    return isinstance(node, ast.Name) and node.id in ("np", "pd")


def combined(left, op, right, scale):
    """Return the unit of a sum, a product or a ratio; None if it is not one of those known."""
    if isinstance(op, ast.Add | ast.Sub):
        return left or right
    if isinstance(op, ast.Div) and left == right == "ms":
        return "readings"
    if isinstance(op, ast.Mult) and {left, right} == {"readings", "ms"}:
        return "ms"
    thousand = isinstance(scale, ast.Constant) and scale.value in (1000, 1000.0)
    if thousand and left == "ms" and isinstance(op, ast.Div):
        return "s"
    return None


def mixed(source, constants=()):
    """Return the axes on which a source draws in several units: scope, axis, lines by unit."""
    tree = ast.parse(source)
    scopes = [("", tree.body)]
    scopes += [(n.name, n.body) for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]
    mixtures = []
    for name, body in scopes:
        units = Units(dict(constants))
        for statement in body:
            units.visit(statement)
        every = [*units.done, *units.axes.items()]
        mixtures += [(name, *axis, each) for axis, each in every if len(each) > 1]
    return mixtures
