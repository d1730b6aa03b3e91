"""The body and the road: their causes, fitted and searched beside those of the sensors."""
