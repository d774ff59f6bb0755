"""The built-in head, loaded from the cache or built."""

from __future__ import annotations

from pathlib import Path

from mocap_fit.face.builtin.cache import get_cache_folder, hash_sources, load_mesh, save_mesh
from mocap_fit.face.mesh import Mesh


def load_built_in_head(*, use_cache: bool = True) -> Mesh:
    """Load the head that comes with mocap-fit: neutral, mirror-symmetric, lips closed.

    It is built by code (about a second) and saved in the user's cache folder, or the folder that
    the environment variable ``MOCAP_FIT_CACHE`` names. The same version gives the same bytes, from
    the cache or not.

    Parameters
    ----------
    use_cache
        False builds it anew and leaves the cache alone.

    Returns
    -------
    Mesh
        Parts ``skin``, ``teeth_upper``, ``teeth_lower``, ``gums_upper``, ``gums_lower``,
        ``tongue``, ``eye_left``, ``eye_right``, ``brow_left``, ``brow_right``, ``lashes_left``,
        ``lashes_right``, ``hair`` and ``shirt``; regions of the skin; MPEG-4 feature points. The
        origin is between the ears at the height of the mouth.
    """
    if use_cache:
        here = Path(__file__).parent
        key = hash_sources(here.parent / "mesh.py", *here.glob("*.py"))
        path = get_cache_folder() / f"head-{key}.npz"
        cached = load_mesh(path)
        if cached is not None:
            return cached
    # Building needs scipy, whose import takes longer than loading the head.
    from mocap_fit.face.builtin.assemble import build_head

    mesh = build_head()
    if use_cache:
        save_mesh(mesh, path)
    return mesh
