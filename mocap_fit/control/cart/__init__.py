"""CART: selection of articulatory targets by regression trees (Krňoul & Železný section 5.1)."""

from mocap_fit.control.cart.drawing import export_svg as export_svg
from mocap_fit.control.cart.drawing import export_text as export_text
from mocap_fit.control.cart.drawing import write_tree as write_tree
from mocap_fit.control.cart.inspecting import Answer as Answer
from mocap_fit.control.cart.inspecting import Reason as Reason
from mocap_fit.control.cart.inspecting import compute_importances as compute_importances
from mocap_fit.control.cart.inspecting import explain_targets as explain_targets
from mocap_fit.control.cart.inspecting import find_tree as find_tree
from mocap_fit.control.cart.model import Cart as Cart
from mocap_fit.control.cart.questions import Attribute as Attribute
from mocap_fit.control.cart.questions import Question as Question
from mocap_fit.control.cart.questions import list_standard_questions as list_standard_questions
from mocap_fit.control.cart.questions import read_questions as read_questions
from mocap_fit.control.cart.tree import Selection as Selection
from mocap_fit.control.cart.tree import Tree as Tree
from mocap_fit.control.cart.tree import TreeKey as TreeKey
