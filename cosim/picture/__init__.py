"""A system as a picture: ``layout`` says where its members are, ``svg`` draws them."""
