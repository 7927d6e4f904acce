"""Case kits: one comparison as a folder for programs that know nothing of this project, and the answer as a folder."""
