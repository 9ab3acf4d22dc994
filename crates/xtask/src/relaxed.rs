//! Replaces relaxed vector instructions in a module.
//!
//! A browser without these instructions rejects the whole module. The instructions come from code
//! that detects support at run time, and from default features of indirect dependencies, which
//! cannot be disabled here. A relaxed multiply-add may round once or twice, so a multiplication
//! followed by an addition is a valid replacement.

use anyhow::{Result, bail};
use walrus::ir::{
    BinaryOp, Binop, Instr, InstrSeq, LocalGet, LocalSet, TernOp, TernaryOp, UnaryOp, Unop, VisitorMut,
    dfs_pre_order_mut,
};
use walrus::{LocalId, Module, ValType};

/// Replaces all relaxed instructions; returns their number.
pub(crate) fn replace(module: &mut Module) -> Result<usize> {
    let mut count = 0;
    let functions: Vec<_> = module.funcs.iter_local().map(|(id, _)| id).collect();
    for id in functions {
        let spare = module.locals.add(ValType::V128);
        let function = module.funcs.get_mut(id).kind.unwrap_local_mut();
        let mut replacer = Replacer { spare, count: 0, unknown: None };
        dfs_pre_order_mut(&mut replacer, function, function.entry_block());
        if let Some(unknown) = replacer.unknown {
            bail!("the module contains the relaxed vector instruction {unknown}, which some browsers reject");
        }
        count += replacer.count;
    }
    Ok(count)
}

struct Replacer {
    /// Local variable of the function, for the summand.
    spare: LocalId,
    count: usize,
    unknown: Option<String>,
}

impl VisitorMut for Replacer {
    fn start_instr_seq_mut(&mut self, sequence: &mut InstrSeq) {
        for at in (0..sequence.instrs.len()).rev() {
            match self.replacement(&sequence.instrs[at].0) {
                Ok(None) => (),
                Ok(Some(instructions)) => {
                    let place = sequence.instrs[at].1;
                    sequence.instrs.splice(at..=at, instructions.into_iter().map(|instruction| (instruction, place)));
                    self.count += 1;
                }
                Err(name) => self.unknown = Some(name),
            }
        }
    }
}

impl Replacer {
    /// Returns instructions equivalent to a relaxed one, or `None` for other instructions. The
    /// error is the name of a relaxed instruction without a known equivalent.
    fn replacement(&self, instruction: &Instr) -> Result<Option<Vec<Instr>>, String> {
        match instruction {
            Instr::TernOp(TernOp { op }) => self.ternary(*op).map(Some),
            Instr::Binop(Binop { op }) => binary(*op).map(|op| op.map(|op| vec![Instr::Binop(Binop { op })])),
            Instr::Unop(Unop { op }) if name(op).contains("Relaxed") => Err(name(op)),
            _ => Ok(None),
        }
    }

    fn ternary(&self, op: TernaryOp) -> Result<Vec<Instr>, String> {
        let (mul, negate, add) = match op {
            TernaryOp::F32x4RelaxedMadd => (BinaryOp::F32x4Mul, None, BinaryOp::F32x4Add),
            TernaryOp::F64x2RelaxedMadd => (BinaryOp::F64x2Mul, None, BinaryOp::F64x2Add),
            TernaryOp::F32x4RelaxedNmadd => (BinaryOp::F32x4Mul, Some(UnaryOp::F32x4Neg), BinaryOp::F32x4Add),
            TernaryOp::F64x2RelaxedNmadd => (BinaryOp::F64x2Mul, Some(UnaryOp::F64x2Neg), BinaryOp::F64x2Add),
            other => return Err(name(&other)),
        };
        let (local, binary) = (self.spare, |op| Instr::Binop(Binop { op }));
        // The summand is on top of the stack, above the two factors.
        let mut instructions = vec![Instr::LocalSet(LocalSet { local }), binary(mul)];
        instructions.extend(negate.map(|op| Instr::Unop(Unop { op })));
        instructions.extend([Instr::LocalGet(LocalGet { local }), binary(add)]);
        Ok(instructions)
    }
}

/// Returns the strict operation that may replace a relaxed one. The results of relaxed operations
/// for signed zeros and NaN are unspecified.
fn binary(op: BinaryOp) -> Result<Option<BinaryOp>, String> {
    Ok(Some(match op {
        BinaryOp::F32x4RelaxedMin => BinaryOp::F32x4Min,
        BinaryOp::F32x4RelaxedMax => BinaryOp::F32x4Max,
        BinaryOp::F64x2RelaxedMin => BinaryOp::F64x2Min,
        BinaryOp::F64x2RelaxedMax => BinaryOp::F64x2Max,
        other if name(&other).contains("Relaxed") => return Err(name(&other)),
        _ => return Ok(None),
    }))
}

fn name(op: &impl std::fmt::Debug) -> String {
    format!("{op:?}")
}

#[cfg(test)]
mod tests {
    use walrus::{FunctionBuilder, ModuleConfig};

    use super::*;

    /// Returns a module whose function applies one instruction to three vectors.
    fn module(op: TernaryOp) -> Module {
        let mut module = Module::with_config(ModuleConfig::new());
        let mut builder = FunctionBuilder::new(&mut module.types, &[ValType::V128; 3], &[ValType::V128]);
        let locals = [(); 3].map(|()| module.locals.add(ValType::V128));
        let mut body = builder.func_body();
        for local in locals {
            body.local_get(local);
        }
        body.instr(TernOp { op });
        let function = builder.finish(locals.to_vec(), &mut module.funcs);
        module.exports.add("f", function);
        module
    }

    #[test]
    fn fused_multiply_adds_are_split() {
        for op in [TernaryOp::F64x2RelaxedMadd, TernaryOp::F32x4RelaxedNmadd] {
            let mut module = module(op);
            assert_eq!(replace(&mut module).unwrap(), 1);
            assert_eq!(replace(&mut module).unwrap(), 0);
            // The emitted module is valid.
            assert!(Module::from_buffer(&module.emit_wasm()).is_ok());
        }
    }

    #[test]
    fn unknown_relaxed_instructions_are_rejected() {
        let error = replace(&mut module(TernaryOp::I8x16RelaxedLaneselect)).unwrap_err();
        assert!(error.to_string().contains("Laneselect"), "{error}");
    }
}
