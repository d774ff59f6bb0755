"""CART: selection of articulatory targets by regression trees (Krňoul & Železný section 5.1)."""

from mocap_fit.control.cart.drawing import export_svg, export_text, write_tree
from mocap_fit.control.cart.inspecting import (
    Answer,
    Reason,
    compute_importances,
    explain_targets,
    find_tree,
)
from mocap_fit.control.cart.model import Cart
from mocap_fit.control.cart.questions import (
    Attribute,
    Question,
    list_standard_questions,
    read_questions,
)
from mocap_fit.control.cart.tree import Selection, Tree, TreeKey

__all__ = [
    "Answer",
    "Attribute",
    "Cart",
    "Question",
    "Reason",
    "Selection",
    "Tree",
    "TreeKey",
    "compute_importances",
    "explain_targets",
    "export_svg",
    "export_text",
    "find_tree",
    "list_standard_questions",
    "read_questions",
    "write_tree",
]
