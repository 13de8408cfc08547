-- Which end of its job a notice tells: 1, or more after a retry.
ALTER TABLE notices ADD COLUMN nth INTEGER NOT NULL DEFAULT 1;
