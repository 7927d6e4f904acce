"""Files of finite-element meshes and of their matrices."""
