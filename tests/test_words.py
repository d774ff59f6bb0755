"""The words of the house, as DESIGN.md has them: what identifiers may be called."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    path for package in ("mocap_fit", "corpus_tools") for path in (ROOT / package).rglob("*.py")
)
every_module = pytest.mark.parametrize(
    "path", MODULES, ids=[path.relative_to(ROOT).as_posix() for path in MODULES]
)

# Never a part of a name, whatever it names.
BANNED = frozenset(
    """
    told tell kept whole made own heard lying asked given room lanes
    """.split()
)
# The field of an error, and a verb.
FOUND, PLACE = "found", "place"

VERBS = frozenset(
    """
    abort accept accumulate act activate adapt add adjust advance aggregate align allocate analyse
    annotate answer append apply approximate arrange assemble assert assign assimilate attach
    average
    backpropagate begin bend bind blend blink bound break bring broadcast build
    calculate calibrate call cancel cap capture carry cast catch change check choose clamp clean
    clear
    clip clone close collect color colour combine compare compile complete compose compute
    concatenate configure connect consume continue convert convolve copy correct correlate count
    cover create crop cut cycle
    debug decode decompose define deform degrade delay delete demand derive describe detect
    determine diagnose differentiate disable discard distribute divide download drag draw drive drop
    ease elaborate eliminate emit enable encode end ensure enter enumerate erase escape estimate
    evaluate exchange execute exit expand explain export express extend extract
    factor fade fail fetch fill filter find finish fit fix flatten flip flush fold follow forget
    format forward frame free freeze
    gather generate get give grade group grow guard guess guide
    handle hash hide hold
    identify ignore import improve index infer inflate initialise inject insert inspect install
    integrate interleave interpolate interrupt intersect introduce invert invoke isolate iterate
    join judge jump
    keep
    label launch learn leave lengthen level lift light limit linearise link list load locate
    lock log look lower
    make map mark mask match maximise measure mend merge minimise mirror mix mount move multiply
    name narrow need normalise note notify number
    observe offset omit open optimise order orient override overlap
    pack pad paint pair parse partition pass paste perturb pick place plan plant play plot point
    pool pop populate position post postpone predict prepare press print process produce project
    promote propagate prune pull push put
    quantise query quote
    raise rank read rebuild receive recognise record recover redo redraw reduce refine refuse
    register reject relabel release remove rename render reopen reorder repair repeat replace
    report represent require resample reset reshape resize resolve restore restrict resume
    retime retrieve retry return reverse rewrite rotate round run
    sample save say scale scan scatter score scroll search seek segment select send separate
    serialise
    serve set shade shape share shift shorten show shrink simplify simulate skip slice slide smooth
    sniff solve sort speak split spread stack standardise start state step stop store stream
    stress stretch strip submit subtract suggest sum summarise suppress swap sweep switch
    synchronise
    synthesise
    take talk taper terminate test throw tidy tie time title trace track train transform
    translate transpose traverse triangulate trim truncate try turn
    unbind undistort undo unescape unfold unite unpack unroll unwrap update use
    validate verify visit
    wait walk warn watch weigh widen wrap write
    yield
    zip zoom
    """.split()
)

# Nouns of what a function returns, where numpy, scipy or scikit-learn would say it so.
NOUNS = frozenset(
    """
    adjoint at between correlation cost covariance default demo derivative dot energy_db equals exp
    factory
    gradient hessian indices info interpolant inverse jacobian kernel log main matrix mean median
    names norm objective orthonormal percentile residual residuals ridge rms smoothstep softmax
    sigmoid std tanh values variance wrapper
    """.split()
)
PREFIXES = ("is_", "has_", "to_", "from_", "as_")

Function = ast.FunctionDef | ast.AsyncFunctionDef


def decorators(node: Function) -> set[str]:
    return {
        ast.unparse(decorator).split("(")[0].split(".")[-1] for decorator in node.decorator_list
    }


def identifiers(tree: ast.Module) -> Iterator[tuple[str, int, str]]:
    """Every name that a module gives, its line, and what it names."""
    for node in ast.walk(tree):
        if isinstance(node, Function):
            yield node.name, node.lineno, "function"
        elif isinstance(node, ast.ClassDef):
            yield node.name, node.lineno, "class"
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno, "parameter"
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno, "variable"
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr, node.lineno, "attribute"
        elif isinstance(node, ast.alias) and node.asname:
            yield node.asname, getattr(node, "lineno", 0), "import"
        elif isinstance(node, ast.ExceptHandler) and node.name:
            yield node.name, node.lineno, "variable"


def faults(path: Path) -> Iterator[str]:
    is_errors = path.name in ("errors.py", "findings.py")
    for name, line, kind in identifiers(ast.parse(path.read_text(encoding="utf-8"))):
        parts = name.strip("_").lower().split("_")
        banned = BANNED.intersection(parts)
        if FOUND in parts and not is_errors:
            banned |= {FOUND}
        if PLACE in parts and not (kind == "function" and parts[0] == PLACE):
            banned |= {PLACE}
        if banned:
            yield f"line {line}: {kind} {name}"


@every_module
def test_names_have_no_private_vocabulary(path):
    assert not list(faults(path))


def functions(tree: ast.Module) -> Iterator[tuple[Function, bool]]:
    """Every function of a module, and whether it is a property."""
    for node in ast.walk(tree):
        if isinstance(node, Function) and not node.name.startswith(("__", "_repr_html_")):
            names = decorators(node)
            if not names & {"override", "overload", "setter"}:
                yield node, bool(names & {"property", "cached_property"})


def begins_well(name: str) -> bool:
    bare = name.lstrip("_")
    return bare in NOUNS or bare.startswith(PREFIXES) or bare.split("_")[0] in VERBS


@every_module
def test_functions_begin_with_a_verb(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    wrong = [
        f"line {node.lineno}: {node.name}"
        for node, is_property in functions(tree)
        if not is_property and not begins_well(node.name)
    ]
    assert not wrong


# Verbs that are nouns too.
ALSO_NOUNS = frozenset(
    """
    answer average bound change color colour cost count cover cut cycle design end estimate
    exchange fill filter fit fold format guess hash index join label level light limit link list
    log look map mark mask match measure name need note number offset order overlap pair plan
    plot point pool position process query rank record release report result return reverse round
    sample scale score segment set shade shape share shift slice smooth sort split spread stack
    start state step stop store stream stretch sum test time title trace track transform turn
    update use watch
    """.split()
)


@every_module
def test_properties_are_nouns(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    wrong = []
    for node, is_property in functions(tree):
        first = node.name.lstrip("_").split("_")[0]
        if is_property and first in VERBS - ALSO_NOUNS:
            wrong.append(f"line {node.lineno}: {node.name}")
    assert not wrong
