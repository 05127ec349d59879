"""A system as a picture: `layout` says where its components are, `svg` draws them."""
