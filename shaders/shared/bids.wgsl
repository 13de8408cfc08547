// What `evaluate_moves` decides about a move: the winner is refused, moves alone, or moves with all
// faces that want the same move.
const REFUSED: u32 = 0u;
const WINNER_MOVES: u32 = 1u;
const ALL_MOVE: u32 = 2u;
