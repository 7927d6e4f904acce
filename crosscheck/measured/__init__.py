"""Records of real machines: read, cut, smoothed, and models identified from them."""
