"""The outline cut by the element grid: pieces, contact points, pressure moments."""
