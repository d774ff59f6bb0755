"""CART: selection of articulatory targets by regression trees (Krňoul & Železný section 5.1)."""

from mocap_fit.control.cart.drawing import tree_svg, tree_text, write_tree
from mocap_fit.control.cart.inspecting import Answer, Reason, find_tree, importance, reasons
from mocap_fit.control.cart.learning import TreeKey
from mocap_fit.control.cart.model import Cart, Chosen
from mocap_fit.control.cart.questions import Attribute, Question, read_questions, standard_questions
from mocap_fit.control.cart.tree import Tree

__all__ = [
    "Answer",
    "Attribute",
    "Cart",
    "Chosen",
    "Question",
    "Reason",
    "Tree",
    "TreeKey",
    "find_tree",
    "importance",
    "read_questions",
    "reasons",
    "standard_questions",
    "tree_svg",
    "tree_text",
    "write_tree",
]
