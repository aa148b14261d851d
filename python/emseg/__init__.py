"""emseg: motion segmentation with event cameras."""
