"""What every room uses: errors, types, colors, boxes, files, pictures, manifests, processes."""
