"""CART: selection of articulatory targets by regression trees (Krňoul & Železný section 5.1)."""

from mocap_fit.control.cart.learning import TreeKey
from mocap_fit.control.cart.model import Cart, Chosen
from mocap_fit.control.cart.questions import Attribute, Question, read_questions, standard_questions
from mocap_fit.control.cart.tree import Tree

__all__ = [
    "Attribute",
    "Cart",
    "Chosen",
    "Question",
    "Tree",
    "TreeKey",
    "read_questions",
    "standard_questions",
]
