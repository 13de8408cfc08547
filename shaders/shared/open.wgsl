// Set in the size of a piece that goes on among faces that are not searched; a whole cluster has fewer faces.
const OPEN: u32 = 0x80000000u;
