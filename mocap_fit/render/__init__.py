"""Pictures and movies of a face, and its movement for other programs."""

from mocap_fit.render.fap import write_fap as write_fap
from mocap_fit.render.gltf import write_gltf as write_gltf
from mocap_fit.render.movie import Movie as Movie
from mocap_fit.render.movie import render_movie as render_movie
from mocap_fit.render.page import Mark as Mark
from mocap_fit.render.page import Page as Page
from mocap_fit.render.page import write_page as write_page
from mocap_fit.render.pictures import save_picture as save_picture
from mocap_fit.render.scene import FaceScene as FaceScene
from mocap_fit.render.scene import render_face as render_face
from mocap_fit.render.scene import require_off_screen as require_off_screen
